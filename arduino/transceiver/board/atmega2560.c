// Arduino Mega 2560: USB on USART0, radio A on USART1 (pins 18, 19), radio B on USART2 (pins 16, 17), RESETB of the
// radios on pins 22 and 23. A line is pulled low or let go, never driven high: the radios live on 3.3 V.
#include "atmega2560.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <util/atomic.h>

#include "../core/board.h"
#include "../core/uart.h"

#define TICKS_PER_MS 250u // Timer 1 counts 4 µs
#define PAINT 0xC5u
#define GUARD_BYTES 8u
#define LARGEST_GAP 96u
#define ALIVE 0xA11Eu
#define STOPPED 0x5709u

// ---- what outlives a reset

static struct {
    uint16_t alive;
    uint16_t stopped;
    uint8_t cause;
    uint8_t detail;
} kept __attribute__((section(".noinit")));

static volatile uint8_t current_task __attribute__((section(".noinit")));
static uint8_t reset_flags __attribute__((section(".noinit")));

// The watchdog stays on through its own reset and would bite again before main.
__attribute__((naked, used, section(".init3"))) static void before_main(void)
{
    reset_flags = MCUSR;
    MCUSR = 0;
    wdt_disable();
}

extern uint8_t _end; // of the variables

__attribute__((naked, used, section(".init3"))) static void paint_stack(void)
{
    // Volatile, so that it does not become a call of memset: there is no stack yet.
    for (volatile uint8_t *byte = &_end; byte <= (uint8_t *)RAMEND; byte++)
        *byte = PAINT;
}

// The boot loader clears the processor's own flags, so what is left in memory must tell.
static struct reset why_reset(void)
{
    struct reset reset = {RESET_CAUSE_POWER_ON, 0};
    if (kept.stopped == STOPPED)
        reset = (struct reset){kept.cause, kept.detail};
    else if (reset_flags & _BV(BORF))
        reset.cause = RESET_CAUSE_BROWN_OUT;
    else if (kept.alive == ALIVE && !(reset_flags & _BV(PORF)))
        reset.cause = RESET_CAUSE_RESET_PIN;
    kept.stopped = 0;
    kept.alive = ALIVE;
    return reset;
}

// ---- serial ports

static volatile bool has_sent[PORT_COUNT];

#define SERIAL_PORT(port, n)                                                                                          \
    ISR(USART##n##_RX_vect)                                                                                           \
    {                                                                                                                 \
        uint8_t status = UCSR##n##A;                                                                                  \
        uint8_t byte = UDR##n;                                                                                        \
        uart_received(&uarts[port], byte, status & _BV(FE##n), status & _BV(DOR##n));                                 \
    }                                                                                                                 \
    ISR(USART##n##_UDRE_vect)                                                                                         \
    {                                                                                                                 \
        struct ring *out = &uarts[port].out;                                                                          \
        if (ring_used(out) == 0) {                                                                                    \
            UCSR##n##B &= (uint8_t)~_BV(UDRIE##n);                                                                    \
            return;                                                                                                   \
        }                                                                                                             \
        UCSR##n##A = _BV(U2X##n) | _BV(TXC##n); /* a one clears TXC */                                                \
        UDR##n = ring_take(out);                                                                                      \
        has_sent[port] = true;                                                                                        \
    }

SERIAL_PORT(PORT_USB, 0)
SERIAL_PORT(PORT_RADIO_A, 1)
SERIAL_PORT(PORT_RADIO_B, 2)

enum { STATUS = 0, CONTROL = 1, FORMAT = 2, DIVISOR_LOW = 4, DIVISOR_HIGH = 5 }; // from the first register of a port

static volatile uint8_t *const registers[PORT_COUNT] = {&UCSR0A, &UCSR1A, &UCSR2A};

#define DIVISOR(baud) ((uint16_t)((F_CPU + 4ul * (baud)) / (8ul * (baud)) - 1ul))
#define REAL_BAUD(baud) (F_CPU / (8ul * (DIVISOR(baud) + 1ul)))
#define IS_NEAR(baud) (REAL_BAUD(baud) * 1000ul / (baud) >= 978ul && REAL_BAUD(baud) * 1000ul / (baud) <= 1022ul)
#define CHECK_RATE(baud) _Static_assert(IS_NEAR(baud), "a receiver stands 2.2 % at most");

FOR_EACH_RADIO_BAUD(CHECK_RATE)
CHECK_RATE(USB_BAUD)

static uint16_t divisor_of(uint32_t baud)
{
    switch (baud) {
#define RATE_CASE(rate) case rate: return DIVISOR(rate);
    FOR_EACH_RADIO_BAUD(RATE_CASE)
    default: return 0;
    }
}

static void set_divisor(uint8_t port, uint16_t divisor)
{
    registers[port][DIVISOR_HIGH] = (uint8_t)(divisor >> 8);
    registers[port][DIVISOR_LOW] = (uint8_t)divisor;
}

static void open_port(uint8_t port, uint16_t divisor)
{
    registers[port][STATUS] = _BV(U2X0);
    set_divisor(port, divisor);
    registers[port][FORMAT] = _BV(UCSZ01) | _BV(UCSZ00); // 8N1
    registers[port][CONTROL] = _BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0);
}

bool board_set_baud(uint8_t port, uint32_t baud)
{
    uint16_t divisor = divisor_of(baud);
    if (divisor)
        set_divisor(port, divisor);
    return divisor != 0;
}

void board_send(uint8_t port)
{
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { registers[port][CONTROL] |= _BV(UDRIE0); }
}

bool board_is_idle(uint8_t port) { return !has_sent[port] || (registers[port][STATUS] & _BV(TXC0)); }

// ---- time

static volatile uint16_t milliseconds;

ISR(TIMER1_COMPA_vect)
{
    OCR1A += TICKS_PER_MS;
    milliseconds++;
}

uint16_t board_now_ms(void)
{
    uint16_t now_ms;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { now_ms = milliseconds; }
    return now_ms;
}

uint16_t board_now_4us(void)
{
    uint16_t now_4us;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { now_4us = TCNT1; } // its high byte goes through a register shared with OCR1A
    return now_4us;
}

// ---- pins

void board_reset_radio(uint8_t radio, bool low)
{
    uint8_t pin = (uint8_t)_BV(PA0 + radio);
    if (low)
        DDRA |= pin;
    else
        DDRA &= (uint8_t)~pin;
}

static void pull_up_receivers(void)
{
    PORTE |= _BV(PE0);
    PORTD |= _BV(PD2);
    PORTH |= _BV(PH0);
}

// ---- supervision

static bool all_is_read(void)
{
    for (uint8_t port = 0; port < PORT_COUNT; port++)
        if (ring_used(&uarts[port].in))
            return false;
    return true;
}

void board_rest(void)
{
    current_task = TASK_REST;
    cli();
    if (all_is_read()) {
        SMCR = _BV(SE); // idle: clock and ports go on
        sei(); // takes effect after the next instruction: no interrupt can come between
        sleep_cpu();
        SMCR = 0;
    }
    sei();
}

void board_enter_task(uint8_t task) { current_task = task; }

bool board_stack_is_whole(void)
{
    for (uint8_t i = 0; i < GUARD_BYTES; i++)
        if ((&_end)[i] != PAINT)
            return false;
    return true;
}

// The lowest byte that the stack has touched. A function may leave a gap as large as its variables untouched.
static uint8_t *lowest_touched = (uint8_t *)RAMEND;

uint16_t board_free_ram(void)
{
    for (uint8_t gap = 0; gap < LARGEST_GAP && lowest_touched - gap > &_end; gap++)
        if (lowest_touched[-1 - gap] != PAINT) {
            lowest_touched -= gap + 1;
            gap = UINT8_MAX; // begins anew at 0
        }
    return (uint16_t)(lowest_touched - &_end);
}

static void set_watchdog(uint8_t bits)
{
    wdt_reset();
    WDTCSR = _BV(WDCE) | _BV(WDE);
    WDTCSR = bits;
}

// First an interrupt after 0.25 s, which knows the task that hung; then the reset.
static void start_watchdog(void) { set_watchdog(_BV(WDIE) | _BV(WDE) | _BV(WDP2)); }

void board_feed_watchdog(void) { wdt_reset(); }

void board_stop(uint8_t cause, uint8_t detail)
{
    cli();
    kept.cause = cause;
    kept.detail = detail;
    kept.stopped = STOPPED;
    set_watchdog(_BV(WDE)); // 16 ms
    for (;;)
        ;
}

ISR(WDT_vect) { board_stop(RESET_CAUSE_HUNG, current_task); }

ISR(BADISR_vect) { board_stop(RESET_CAUSE_BAD_INTERRUPT, current_task); }

struct reset board_init(void)
{
    struct reset reset = why_reset();
    TCCR1B = _BV(CS11) | _BV(CS10);
    OCR1A = TICKS_PER_MS;
    TIMSK1 = _BV(OCIE1A);
    pull_up_receivers();
    open_port(PORT_USB, DIVISOR(USB_BAUD));
    open_port(PORT_RADIO_A, DIVISOR(DEFAULT_RADIO_BAUD));
    open_port(PORT_RADIO_B, DIVISOR(DEFAULT_RADIO_BAUD));
    start_watchdog();
    sei();
    return reset;
}
