#include "mcu.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_hex.h>

#define FREQUENCY_HZ 16000000u
#define CYCLES_PER_US 16u
#define FEED_EVERY_CYCLES (50u * CYCLES_PER_US)
#define RESET_PINS 0x03u // PA0 and PA1
#define UCSRA 0xC0u // of USART0; the others follow every 8 bytes
#define PORT_STRIDE 8u
#define UBRRL_OFFSET 4u
#define VECTOR_BYTES 4u
#define FIRST_RAM 0x200u

struct mcu_port mcu_ports[PORTS];

static avr_t *avr;
static void (*core_reset)(avr_t *avr);
static struct {
    bool ready; // the processor's own short queue takes more
    uint32_t baud;
    avr_irq_t *input;
} wires[PORTS];
static struct patch { // an instruction that a fault put in the place of another
    bool active;
    avr_flashaddr_t at;
    uint8_t instruction[2];
} hang, mute;
static const avr_flashaddr_t sending_vectors[PORTS] = {26, 37, 52}; // USARTn, data register empty
static uint8_t low_pins;

size_t queue_put(struct queue *queue, const uint8_t *bytes, size_t count)
{
    size_t room = QUEUE_BYTES - queue->count;
    size_t taken = count < room ? count : room;
    memcpy(queue->bytes + queue->count, bytes, taken);
    queue->count += taken;
    queue->lost += count - taken;
    return taken;
}

void queue_drop(struct queue *queue, size_t count)
{
    queue->count -= count;
    memmove(queue->bytes, queue->bytes + count, queue->count);
}

static void on_output(struct avr_irq_t *irq, uint32_t value, void *port)
{
    (void)irq;
    uint8_t byte = (uint8_t)value;
    queue_put(&((struct mcu_port *)port)->out, &byte, 1);
}

static void on_ready(struct avr_irq_t *irq, uint32_t value, void *ready)
{
    (void)irq, (void)value;
    *(bool *)ready = true;
}

static void on_full(struct avr_irq_t *irq, uint32_t value, void *ready)
{
    (void)irq;
    if (value)
        *(bool *)ready = false;
}

static void connect(int port)
{
    char name = (char)('0' + port);
    uint32_t flags = 0; // no echo on the terminal, no sleeping in polls
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS(name), &flags);
    wires[port].input = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ(name), UART_IRQ_INPUT);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ(name), UART_IRQ_OUTPUT), on_output,
                            &mcu_ports[port]);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ(name), UART_IRQ_OUT_XON), on_ready,
                            &wires[port].ready);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ(name), UART_IRQ_OUT_XOFF), on_full,
                            &wires[port].ready);
}

static void begin_fault(struct patch *patch, avr_flashaddr_t at, uint16_t instruction)
{
    if (patch->active)
        return;
    *patch = (struct patch){true, at, {avr->flash[at], avr->flash[at + 1]}};
    avr->flash[at] = (uint8_t)instruction;
    avr->flash[at + 1] = (uint8_t)(instruction >> 8);
}

static void end_fault(struct patch *patch)
{
    if (patch->active)
        memcpy(avr->flash + patch->at, patch->instruction, sizeof patch->instruction);
    patch->active = false;
}

// Bounds how long the processor sleeps in one piece.
static avr_cycle_count_t wake(avr_t *of, avr_cycle_count_t when, void *unused)
{
    (void)of, (void)unused;
    return when + FEED_EVERY_CYCLES;
}

static void on_reset(avr_t *of)
{
    avr_cycle_timer_register(of, FEED_EVERY_CYCLES, wake, NULL);
    end_fault(&hang);
    end_fault(&mute);
    for (int port = 0; port < PORTS; port++)
        wires[port].ready = false;
    if (core_reset)
        core_reset(of);
    puts("event reset");
}

static bool load(const char *path)
{
    ihex_chunk_p chunks = NULL;
    int count = read_ihex_chunks(path, &chunks);
    if (count <= 0)
        return false;
    bool fits = true;
    for (int i = 0; i < count; i++) {
        fits = fits && chunks[i].baseaddr + chunks[i].size <= avr->flashend + 1u;
        if (fits)
            memcpy(avr->flash + chunks[i].baseaddr, chunks[i].data, chunks[i].size);
    }
    avr->reset_pc = chunks[0].baseaddr; // a boot loader, loaded last, is where the fuses make the processor begin
    free_ihex_chunks(chunks);
    return fits;
}

static void quiet(avr_t *of, const int level, const char *format, va_list arguments)
{
    (void)of, (void)level, (void)format, (void)arguments;
}

// Time goes on while the processor sleeps; the caller paces it.
static void pass_time(avr_t *of, avr_cycle_count_t cycles) { (void)of, (void)cycles; }

bool mcu_open(const char *firmware, const char *boot_loader)
{
    avr_global_logger_set(quiet);
    avr = avr_make_mcu_by_name("atmega2560");
    if (!avr)
        return false;
    avr_init(avr);
    avr->frequency = FREQUENCY_HZ;
    avr->log = LOG_ERROR;
    avr->sleep = pass_time;
    memset(avr->flash, 0xFF, avr->flashend + 1u);
    if (!load(firmware) || (boot_loader && !load(boot_loader)))
        return false;
    avr->codeend = avr->flashend;
    core_reset = avr->reset;
    avr->reset = on_reset;
    for (int port = 0; port < PORTS; port++)
        connect(port);
    mcu_power_cycle();
    return true;
}

static uint8_t *register_of(int port, unsigned offset) { return &avr->data[UCSRA + PORT_STRIDE * port + offset]; }

static void feed(int port)
{
    struct queue *in = &mcu_ports[port].in;
    size_t fed = 0;
    while (wires[port].ready && fed < in->count)
        avr_raise_irq(wires[port].input, in->bytes[fed++]);
    if (fed)
        queue_drop(in, fed);
}

static void tell_baud(int port)
{
    uint32_t divisor = *register_of(port, UBRRL_OFFSET) | (uint32_t)*register_of(port, UBRRL_OFFSET + 1) << 8;
    uint32_t baud = FREQUENCY_HZ / (8u * (divisor + 1u));
    if (baud == wires[port].baud || divisor == 0)
        return;
    wires[port].baud = baud;
    printf("event baud %d %u\n", port, baud);
}

static void tell_pins(void)
{
    avr_ioport_state_t state;
    if (avr_ioctl(avr, AVR_IOCTL_IOPORT_GETSTATE('A'), &state) < 0)
        return;
    uint8_t low = (uint8_t)(state.ddr & ~state.port & RESET_PINS);
    for (int radio = 0; radio < 2; radio++)
        if ((low ^ low_pins) & (1u << radio))
            printf("event resetb %d %d\n", radio, low & (1u << radio) ? 0 : 1);
    low_pins = low;
}

static void run_until(avr_cycle_count_t end)
{
    while (avr->cycle < end) {
        int state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed) {
            puts("event crashed");
            fflush(stdout);
            exit(3);
        }
    }
}

void mcu_run(uint64_t us)
{
    avr_cycle_count_t end = avr->cycle + us * CYCLES_PER_US;
    while (avr->cycle < end) {
        avr_cycle_count_t next = avr->cycle + FEED_EVERY_CYCLES;
        run_until(next < end ? next : end);
        for (int port = 0; port < PORTS; port++) {
            feed(port);
            tell_baud(port);
        }
        tell_pins();
    }
}

uint64_t mcu_now_us(void) { return avr->cycle / CYCLES_PER_US; }

void mcu_reset(void)
{
    for (int port = 0; port < PORTS; port++)
        mcu_ports[port].in.count = 0;
    avr_reset(avr);
}

void mcu_power_cycle(void)
{
    memset(avr->data + FIRST_RAM, 0x55, avr->ramend + 1u - FIRST_RAM);
    mcu_reset();
}

void mcu_hang(void)
{
    while (!avr->sreg[S_I]) // not inside an interrupt
        run_until(avr->cycle + 1);
    begin_fault(&hang, avr->pc, 0xCFFF); // rjmp .-2: here, for ever
}

void mcu_mute(int port) { begin_fault(&mute, sending_vectors[port] * VECTOR_BYTES, 0x9518); } // reti
