#include "transceiver.h"

#include "board.h"
#include "command.h"
#include "health.h"
#include "session.h"

// No task takes long, or the rings of the others would overflow meanwhile.
#define FROM_HOST_PER_TURN 48u
#define FROM_RADIO_PER_TURN 32u

struct uart uarts[PORT_COUNT];

static struct frame_reader reader;

static uint8_t port_of(uint8_t radio) { return (uint8_t)(PORT_RADIO_A + radio); }

// ---- frames from the host

static void on_data(const uint8_t *body, uint8_t size)
{
    const struct data *head = (const struct data *)body;
    if (head->radio < RADIOS)
        to_radio_receive(&to_radio[head->radio], head->offset, body + sizeof *head, (uint8_t)(size - sizeof *head));
}

static void on_acknowledge(const struct acknowledge *body, uint16_t now_ms)
{
    if (body->radio < RADIOS)
        to_host_acknowledge(&to_host[body->radio], body, now_ms);
}

static void on_ping(const struct ping *body)
{
    if (body->wants_health)
        health_tell();
    for (uint8_t radio = 0; radio < RADIOS; radio++)
        to_radio[radio].tell = true;
}

// The size that a frame of this number must have, 0 for one that the host does not send.
static uint8_t size_of(uint8_t number, uint8_t size)
{
    switch (number) {
    case FRAME_HELLO: return sizeof(struct hello);
    case FRAME_ACKNOWLEDGE: return sizeof(struct acknowledge);
    case FRAME_PING: return sizeof(struct ping);
    case FRAME_SET_BAUD: return sizeof(struct set_baud);
    case FRAME_RESET_RADIO: return sizeof(struct reset_radio);
    case FRAME_DATA: return size > sizeof(struct data) ? size : UINT8_MAX;
    default: return 0; // a goodbye has no body
    }
}

static bool is_known(uint8_t number, uint8_t size)
{
    return size == size_of(number, size) && (size || number == FRAME_GOODBYE);
}

static void in_session(uint8_t number, const uint8_t *body, uint8_t size, uint16_t now_ms)
{
    session.heard_ms = now_ms;
    switch (number) {
    case FRAME_DATA: on_data(body, size); break;
    case FRAME_ACKNOWLEDGE: on_acknowledge((const struct acknowledge *)body, now_ms); break;
    case FRAME_PING: on_ping((const struct ping *)body); break;
    case FRAME_SET_BAUD: command_set_baud((const struct set_baud *)body); break;
    case FRAME_RESET_RADIO: command_reset_radio((const struct reset_radio *)body, now_ms); break;
    case FRAME_GOODBYE: session_goodbye(); break;
    }
}

static void on_frame(uint16_t now_ms)
{
    uint8_t number = reader.content[0];
    const uint8_t *body = reader.content + 1;
    uint8_t size = (uint8_t)(reader.length - 1u);
    if (!is_known(number, size)) {
        health_count(FAULT_BAD_FRAME, PORT_USB, 1);
        return;
    }
    health_frame_in();
    if (number == FRAME_HELLO)
        session_hello((const struct hello *)body, now_ms);
    else if (session.number)
        in_session(number, body, size, now_ms);
}

// ---- tasks

static void from_host(uint16_t now_ms)
{
    struct ring *in = &uarts[PORT_USB].in;
    health_mark(RING_IN(PORT_USB), ring_used(in));
    for (uint8_t n = FROM_HOST_PER_TURN; n && ring_used(in); n--) {
        enum frame_event event = frame_read(&reader, ring_take(in));
        if (event == FRAME_READY)
            on_frame(now_ms);
        else if (event == FRAME_DAMAGED)
            health_count(FAULT_BAD_FRAME, PORT_USB, 1);
    }
}

static void to_radios(uint16_t now_ms)
{
    (void)now_ms;
    for (uint8_t radio = 0; radio < RADIOS; radio++)
        if (to_radio_move(&to_radio[radio], &uarts[port_of(radio)].out))
            board_send(port_of(radio));
}

static void from_radio(uint8_t radio, uint16_t now_ms)
{
    struct ring *in = &uarts[port_of(radio)].in;
    uint16_t lost = 0;
    uint8_t count = ring_used(in);
    health_mark(RING_IN(port_of(radio)), count);
    if (count > FROM_RADIO_PER_TURN)
        count = FROM_RADIO_PER_TURN;
    for (uint8_t n = count; n; n--) {
        uint8_t byte = ring_take(in);
        if (session.number && !to_host_put(&to_host[radio], byte, now_ms))
            lost++;
    }
    health_radio_in(radio, count);
    health_count(FAULT_STREAM_FULL, port_of(radio), lost);
}

static void from_radios(uint16_t now_ms)
{
    for (uint8_t radio = 0; radio < RADIOS; radio++)
        from_radio(radio, now_ms);
}

static void to_hosts(uint16_t now_ms)
{
    if (session.number && !session.welcome)
        for (uint8_t radio = 0; radio < RADIOS; radio++)
            to_host_send(&to_host[radio], radio, usb_out(), now_ms);
    uint8_t used = ring_used(usb_out());
    health_mark(RING_OUT(PORT_USB), used);
    if (used)
        board_send(PORT_USB);
}

static void (*const tasks[TASK_REST])(uint16_t now_ms) = {
    [TASK_FROM_HOST] = from_host, [TASK_TO_RADIO] = to_radios,      [TASK_FROM_RADIO] = from_radios,
    [TASK_TO_HOST] = to_hosts,    [TASK_COMMAND] = command_task,    [TASK_SESSION] = session_task,
    [TASK_HEALTH] = health_task,  [TASK_SUPERVISOR] = supervisor_task,
};

void transceiver_init(uint8_t reset_cause, uint8_t reset_detail)
{
    uint16_t now_ms = board_now_ms();
    frame_reader_init(&reader);
    session_init(reset_cause, reset_detail, now_ms);
    command_init();
    health_init(now_ms);
}

void transceiver_loop(void)
{
    uint16_t began_4us = board_now_4us();
    uint16_t now_ms = board_now_ms();
    for (uint8_t task = 0; task < TASK_REST; task++) {
        board_enter_task(task);
        tasks[task](now_ms);
    }
    health_loop_took((uint16_t)(board_now_4us() - began_4us));
}
