// What the tasks share. Each part of the core owns its own state; this is the common part.
#pragma once

#include "frame.h"
#include "stream.h"
#include "uart.h"

struct session {
    uint32_t number; // 0: none
    uint8_t reset_cause;
    uint8_t reset_detail;
    bool welcome;
    bool refuse;
    uint16_t heard_ms;
    uint16_t announced_ms;
};

extern struct session session;
extern struct to_host to_host[RADIOS];
extern struct to_radio to_radio[RADIOS];

static inline struct ring *usb_out(void) { return &uarts[PORT_USB].out; }

void session_init(uint8_t reset_cause, uint8_t reset_detail, uint16_t now_ms);
void session_hello(const struct hello *hello, uint16_t now_ms);
void session_goodbye(void);
void session_task(uint16_t now_ms);
