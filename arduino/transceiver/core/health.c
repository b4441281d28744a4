#include "health.h"

#include "board.h"
#include "command.h"
#include "session.h"

#define REPORT_EVERY_MS 100u
#define STUCK_MS 500u
#define RINGS (2u * PORT_COUNT)

static struct counters {
    uint32_t uptime_ms;
    uint32_t frames_in;
    uint32_t bytes_in[RADIOS];
    uint32_t bytes_out[RADIOS];
    uint16_t faults[FAULT_COUNT][PORT_COUNT];
    uint16_t reported[FAULT_COUNT][PORT_COUNT];
    uint16_t longest_4us;
    uint16_t last_ms;
    uint16_t reported_ms;
    uint8_t seen[PORT_COUNT][3]; // the interrupts' counters that have been added up
    uint8_t taken[RADIOS]; // tails of the sending rings that have been added up
    uint8_t high_water[RINGS];
    uint8_t due; // answers to a ping that have not been sent
} health;

// Each ring by its last move: one that holds bytes and stands still has lost its interrupt or its task.
static struct {
    uint8_t tail;
    uint16_t moved_ms;
} moves[RINGS];

static struct ring *ring_of(uint8_t index)
{
    struct uart *uart = &uarts[index / 2u];
    return index % 2u ? &uart->out : &uart->in;
}

void health_init(uint16_t now_ms)
{
    health = (struct counters){0};
    health.last_ms = health.reported_ms = now_ms;
    for (uint8_t index = 0; index < RINGS; index++) {
        moves[index].tail = ring_of(index)->tail;
        moves[index].moved_ms = now_ms;
    }
    for (uint8_t port = 0; port < PORT_COUNT; port++) {
        health.seen[port][FAULT_FRAMING] = uarts[port].framing;
        health.seen[port][FAULT_OVERRUN] = uarts[port].overrun;
        health.seen[port][FAULT_RING_FULL] = uarts[port].ring_full;
    }
    for (uint8_t radio = 0; radio < RADIOS; radio++)
        health.taken[radio] = uarts[PORT_RADIO_A + radio].out.tail;
}

void health_frame_in(void) { health.frames_in++; }

void health_radio_in(uint8_t radio, uint16_t bytes) { health.bytes_in[radio] += bytes; }

void health_count(uint8_t fault, uint8_t port, uint16_t more)
{
    uint16_t *total = &health.faults[fault][port];
    *total = (uint16_t)(*total + more);
}

void health_tell(void) { health.due = 1u + RADIOS; }

static void add_up(uint8_t port)
{
    const uint8_t now[] = {uarts[port].framing, uarts[port].overrun, uarts[port].ring_full};
    for (uint8_t fault = FAULT_FRAMING; fault <= FAULT_RING_FULL; fault++) {
        health_count(fault, port, (uint8_t)(now[fault] - health.seen[port][fault]));
        health.seen[port][fault] = now[fault];
    }
}

void health_mark(uint8_t ring, uint8_t used)
{
    if (used > health.high_water[ring])
        health.high_water[ring] = used;
}

void health_loop_took(uint16_t loop_4us)
{
    if (loop_4us > health.longest_4us)
        health.longest_4us = loop_4us;
}

static void add_up_all(uint16_t now_ms)
{
    health.uptime_ms += (uint16_t)(now_ms - health.last_ms);
    health.last_ms = now_ms;
    for (uint8_t port = 0; port < PORT_COUNT; port++)
        add_up(port);
    for (uint8_t radio = 0; radio < RADIOS; radio++) {
        uint8_t tail = uarts[PORT_RADIO_A + radio].out.tail;
        health.bytes_out[radio] += (uint8_t)(tail - health.taken[radio]);
        health.taken[radio] = tail;
    }
}

static bool tell_own(void)
{
    uint32_t longest_us = 4ul * health.longest_4us;
    struct health body = {
        .uptime_ms = health.uptime_ms,
        .reset_cause = session.reset_cause,
        .reset_detail = session.reset_detail,
        .free_ram_bytes = board_free_ram(),
        .longest_loop_us = longest_us > 0xFFFFu ? 0xFFFFu : (uint16_t)longest_us,
        .frames_in = health.frames_in,
        .usb_bad_frames = health.faults[FAULT_BAD_FRAME][PORT_USB],
        .usb_framing = health.faults[FAULT_FRAMING][PORT_USB],
        .usb_overrun = health.faults[FAULT_OVERRUN][PORT_USB],
        .usb_ring_full = health.faults[FAULT_RING_FULL][PORT_USB],
        .usb_in_high_water = health.high_water[RING_IN(PORT_USB)],
        .usb_out_high_water = health.high_water[RING_OUT(PORT_USB)],
    };
    return frame_write(usb_out(), FRAME_HEALTH, &body, sizeof body, 0, 0);
}

static bool tell_radio(uint8_t radio)
{
    uint8_t port = (uint8_t)(PORT_RADIO_A + radio);
    struct radio_health body = {
        .radio = radio,
        .baud = command_baud(radio),
        .bytes_in = health.bytes_in[radio],
        .bytes_out = health.bytes_out[radio],
        .resent_bytes = to_host[radio].resent,
        .framing = health.faults[FAULT_FRAMING][port],
        .overrun = health.faults[FAULT_OVERRUN][port],
        .ring_full = health.faults[FAULT_RING_FULL][port],
        .stream_full = health.faults[FAULT_STREAM_FULL][port],
        .ring_in_high_water = health.high_water[RING_IN(port)],
        .to_host_high_water = to_host[radio].high_water,
        .to_radio_high_water = to_radio[radio].high_water,
    };
    return frame_write(usb_out(), FRAME_RADIO_HEALTH, &body, sizeof body, 0, 0);
}

static void answer_ping(void)
{
    if (health.due > RADIOS && tell_own())
        health.due--;
    else if (health.due && health.due <= RADIOS && tell_radio((uint8_t)(RADIOS - health.due)))
        health.due--;
}

static bool report(uint8_t fault, uint8_t port)
{
    uint16_t total = health.faults[fault][port];
    struct fault_report body = {fault, port, total};
    if (total == health.reported[fault][port] ||
        !frame_write(usb_out(), FRAME_FAULT_REPORT, &body, sizeof body, 0, 0))
        return false;
    health.reported[fault][port] = total;
    return true;
}

static void report_one(void)
{
    for (uint8_t fault = 0; fault < FAULT_COUNT; fault++)
        for (uint8_t port = 0; port < PORT_COUNT; port++)
            if (report(fault, port))
                return;
}

void health_task(uint16_t now_ms)
{
    if (now_ms == health.last_ms)
        return;
    add_up_all(now_ms);
    if (session.number == 0)
        return;
    answer_ping();
    if ((uint16_t)(now_ms - health.reported_ms) >= REPORT_EVERY_MS) {
        health.reported_ms = now_ms;
        report_one();
    }
}

void supervisor_task(uint16_t now_ms)
{
    static uint16_t fed_ms;
    if (now_ms == fed_ms) // a clock that stands still must not be fed
        return;
    for (uint8_t index = 0; index < RINGS; index++) {
        struct ring *ring = ring_of(index);
        if (ring_used(ring) == 0 || ring->tail != moves[index].tail) {
            moves[index].tail = ring->tail;
            moves[index].moved_ms = now_ms;
        } else if ((uint16_t)(now_ms - moves[index].moved_ms) >= STUCK_MS) {
            board_stop(RESET_CAUSE_RING_STUCK, index);
            return;
        }
    }
    if (!board_stack_is_whole()) {
        board_stop(RESET_CAUSE_STACK_OVERFLOW, 0);
        return;
    }
    fed_ms = now_ms;
    board_feed_watchdog();
}
