// The serial ports as the core sees them: two rings and what went wrong. The board's interrupts are at the other end.
#pragma once

#include "protocol_gen.h"
#include "ring.h"

struct uart {
    struct ring in;
    struct ring out;
    // Counted by interrupts in one byte, which the main loop reads whole and adds up before it comes round.
    volatile uint8_t framing;
    volatile uint8_t overrun;
    volatile uint8_t ring_full;
};

extern struct uart uarts[PORT_COUNT];

// Called by the receive interrupt; a byte with a wrong stop bit is not passed on.
static inline void uart_received(struct uart *uart, uint8_t byte, bool framing, bool overrun)
{
    if (overrun)
        uart->overrun++;
    if (framing)
        uart->framing++;
    else if (!ring_put(&uart->in, byte))
        uart->ring_full++;
}
