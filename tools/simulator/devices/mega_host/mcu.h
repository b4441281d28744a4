// The ATmega2560 of a Mega, run by libsimavr, with its three serial ports as queues of bytes.
#pragma once

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define PORTS 3
#define QUEUE_BYTES 16384u // more than a test or a driver has under way; what does not fit is lost, as on a wire

struct queue {
    uint8_t bytes[QUEUE_BYTES];
    size_t count;
    unsigned long lost;
};

size_t queue_put(struct queue *queue, const uint8_t *bytes, size_t count);
void queue_drop(struct queue *queue, size_t count); // from the front

struct mcu_port {
    struct queue in; // on its way to the processor, which takes it at its own rate
    struct queue out;
};

extern struct mcu_port mcu_ports[PORTS];

bool mcu_open(const char *firmware, const char *boot_loader); // Intel hex; the second may be NULL
void mcu_run(uint64_t us);
uint64_t mcu_now_us(void);
void mcu_reset(void); // the button
void mcu_power_cycle(void); // memory is lost
void mcu_hang(void); // the main loop stays where it is, interrupts go on, until the next reset
void mcu_mute(int port); // the port's sending interrupt does nothing, until the next reset
