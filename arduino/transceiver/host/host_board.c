// The core as a library for tests: time, wires and pins are variables, and an interrupt is a function call.
#include <stddef.h>

#include "../core/board.h"
#include "../core/transceiver.h"
#include "../core/uart.h"

struct stop {
    int cause; // -1: none
    int detail;
};

static struct {
    uint16_t now_ms;
    bool is_idle[PORT_COUNT];
    bool is_low[RADIOS];
    uint32_t baud[PORT_COUNT];
    uint32_t fed;
    struct stop stop;
} board;

// Says how this library is to be checked; the sanitizer comes late into a Python that was built without it.
const char *__asan_default_options(void);
const char *__asan_default_options(void) { return "verify_asan_link_order=0:detect_leaks=0:handle_segv=0"; }

uint16_t board_now_ms(void) { return board.now_ms; }
uint16_t board_now_4us(void) { return (uint16_t)(board.now_ms * 250u); }
void board_send(uint8_t port) { board.is_idle[port] = false; }
bool board_is_idle(uint8_t port) { return board.is_idle[port]; }
void board_reset_radio(uint8_t radio, bool low) { board.is_low[radio] = low; }
void board_rest(void) {}
void board_enter_task(uint8_t task) { (void)task; }
uint16_t board_free_ram(void) { return 1234; }
bool board_stack_is_whole(void) { return true; }
void board_feed_watchdog(void) { board.fed++; }

bool board_set_baud(uint8_t port, uint32_t baud)
{
    switch (baud) {
#define RATE_CASE(rate) case rate:
    FOR_EACH_RADIO_BAUD(RATE_CASE)
        board.baud[port] = baud;
        return true;
    default: return false;
    }
}

void board_stop(uint8_t cause, uint8_t detail)
{
    if (board.stop.cause < 0)
        board.stop = (struct stop){cause, detail};
}

void host_start(uint8_t cause, uint8_t detail)
{
    board.now_ms = 0;
    board.fed = 0;
    board.stop = (struct stop){-1, 0};
    for (uint8_t port = 0; port < PORT_COUNT; port++) {
        uarts[port] = (struct uart){.framing = uarts[port].framing};
        board.is_idle[port] = true;
        board.baud[port] = DEFAULT_RADIO_BAUD;
    }
    transceiver_init(cause, detail);
}

void host_advance(uint16_t ms) { board.now_ms = (uint16_t)(board.now_ms + ms); }
void host_loop(void) { transceiver_loop(); }

// Bytes come in on a port's wire; how many the ring took.
size_t host_arrive(uint8_t port, const uint8_t *bytes, size_t count)
{
    size_t taken = 0;
    for (size_t i = 0; i < count; i++) {
        taken += ring_room(&uarts[port].in) > 0;
        uart_received(&uarts[port], bytes[i], false, false);
    }
    return taken;
}

void host_disturb(uint8_t port, bool framing, bool overrun) { uart_received(&uarts[port], 0x55, framing, overrun); }

// Bytes leave on a port's wire.
size_t host_leave(uint8_t port, uint8_t *bytes, size_t most)
{
    size_t count = 0;
    while (count < most && ring_used(&uarts[port].out))
        bytes[count++] = ring_take(&uarts[port].out);
    if (ring_used(&uarts[port].out) == 0)
        board.is_idle[port] = true;
    return count;
}

// All bytes into USB and radio A, with as many loops as a portion needs and a millisecond after it; what comes out on
// all wires is counted and thrown away. For fuzzing.
size_t host_flood(const uint8_t *bytes, size_t count, size_t portion)
{
    size_t left = 0;
    uint8_t thrown[RING_CAPACITY];
    for (size_t at = 0; at < count; at += portion) {
        size_t size = count - at < portion ? count - at : portion;
        host_arrive(PORT_USB, bytes + at, size);
        host_arrive(PORT_RADIO_A, bytes + at, size);
        for (size_t turn = 0; turn <= size / 32; turn++)
            transceiver_loop();
        board.now_ms++;
        for (uint8_t port = 0; port < PORT_COUNT; port++)
            left += host_leave(port, thrown, sizeof thrown);
    }
    return left;
}

bool host_is_low(uint8_t radio) { return board.is_low[radio]; }
uint32_t host_baud(uint8_t port) { return board.baud[port]; }
uint32_t host_fed(void) { return board.fed; }
int host_stop_cause(void) { return board.stop.cause; }
int host_stop_detail(void) { return board.stop.detail; }
