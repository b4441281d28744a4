#include "command.h"

#include "board.h"
#include "session.h"

enum state { IDLE, SETTING_BAUD, RESETTING, ANSWERING };

static struct {
    enum state state;
    uint8_t tag; // of the command that is, or was last, carried out
    uint8_t result;
    uint8_t radio;
    uint16_t since_ms;
    uint16_t low_ms;
    uint32_t baud;
} command;

static uint32_t bauds[RADIOS];

void command_init(void)
{
    command.state = IDLE;
    command.tag = 0;
    for (uint8_t radio = 0; radio < RADIOS; radio++)
        bauds[radio] = DEFAULT_RADIO_BAUD;
}

uint32_t command_baud(uint8_t radio) { return bauds[radio]; }

void command_forget(void)
{
    if (command.state == RESETTING)
        board_reset_radio(command.radio, false);
    command.state = IDLE;
    command.tag = 0;
}

static void answer(uint8_t result)
{
    command.result = result;
    command.state = ANSWERING;
}

// False when there is nothing to begin: it came before, another is being carried out, or it makes no sense.
static bool begin(uint8_t tag, uint8_t radio)
{
    if (command.state != IDLE)
        return false;
    if (tag == command.tag) {
        command.state = ANSWERING;
        return false;
    }
    command.tag = tag;
    command.radio = radio;
    if (radio < RADIOS)
        return true;
    answer(RESULT_BAD_VALUE);
    return false;
}

void command_set_baud(const struct set_baud *wanted)
{
    if (!begin(wanted->tag, wanted->radio))
        return;
    command.baud = wanted->baud;
    command.state = SETTING_BAUD;
}

void command_reset_radio(const struct reset_radio *wanted, uint16_t now_ms)
{
    if (!begin(wanted->tag, wanted->radio))
        return;
    if (wanted->low_ms == 0 || wanted->low_ms > MAX_RESET_MS) {
        answer(RESULT_BAD_VALUE);
        return;
    }
    command.low_ms = wanted->low_ms;
    command.since_ms = now_ms;
    command.state = RESETTING;
    board_reset_radio(command.radio, true);
}

static void set_baud_when_all_is_out(void)
{
    uint8_t port = (uint8_t)(PORT_RADIO_A + command.radio);
    if (!to_radio_is_empty(&to_radio[command.radio]) || ring_used(&uarts[port].out) || !board_is_idle(port))
        return;
    if (!board_set_baud(port, command.baud)) {
        answer(RESULT_BAD_VALUE);
        return;
    }
    bauds[command.radio] = command.baud;
    answer(RESULT_DONE);
}

static void end_reset(uint16_t now_ms)
{
    if ((uint16_t)(now_ms - command.since_ms) < command.low_ms)
        return;
    board_reset_radio(command.radio, false);
    answer(RESULT_DONE);
}

void command_task(uint16_t now_ms)
{
    if (command.state == SETTING_BAUD)
        set_baud_when_all_is_out();
    else if (command.state == RESETTING)
        end_reset(now_ms);
    if (command.state != ANSWERING)
        return;
    struct done body = {command.tag, command.result};
    if (frame_write(usb_out(), FRAME_DONE, &body, sizeof body, 0, 0))
        command.state = IDLE;
}
