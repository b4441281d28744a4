#include "session.h"

#include "command.h"

struct session session;
struct to_host to_host[RADIOS];
struct to_radio to_radio[RADIOS];

void session_init(uint8_t reset_cause, uint8_t reset_detail, uint16_t now_ms)
{
    session = (struct session){.reset_cause = reset_cause, .reset_detail = reset_detail};
    session.announced_ms = (uint16_t)(now_ms - ANNOUNCE_EVERY_MS);
    for (uint8_t radio = 0; radio < RADIOS; radio++) {
        to_host[radio] = (struct to_host){0};
        to_radio[radio] = (struct to_radio){0};
    }
}

static void begin(uint32_t number)
{
    session.number = number;
    for (uint8_t radio = 0; radio < RADIOS; radio++) {
        to_host_reset(&to_host[radio]);
        to_radio_reset(&to_radio[radio]);
    }
    command_forget();
}

void session_hello(const struct hello *hello, uint16_t now_ms)
{
    if (hello->fingerprint != PROTOCOL_FINGERPRINT) {
        session.refuse = true;
        return;
    }
    if (hello->session == 0)
        return;
    if (hello->session != session.number)
        begin(hello->session);
    session.heard_ms = now_ms;
    session.welcome = true;
}

void session_goodbye(void) { session.number = 0; }

static void answer(void)
{
    struct welcome welcome = {session.number, FIRMWARE_MAJOR, FIRMWARE_MINOR, session.reset_cause,
                              session.reset_detail};
    if (session.welcome && frame_write(usb_out(), FRAME_WELCOME, &welcome, sizeof welcome, 0, 0))
        session.welcome = false;
    struct refuse refuse = {PROTOCOL_FINGERPRINT};
    if (session.refuse && frame_write(usb_out(), FRAME_REFUSE, &refuse, sizeof refuse, 0, 0))
        session.refuse = false;
}

static void announce(uint16_t now_ms)
{
    if ((uint16_t)(now_ms - session.announced_ms) < ANNOUNCE_EVERY_MS)
        return;
    struct announce body = {PROTOCOL_FINGERPRINT, FIRMWARE_MAJOR, FIRMWARE_MINOR, session.reset_cause,
                            session.reset_detail};
    if (frame_write(usb_out(), FRAME_ANNOUNCE, &body, sizeof body, 0, 0))
        session.announced_ms = now_ms;
}

void session_task(uint16_t now_ms)
{
    answer();
    if (session.number == 0) {
        announce(now_ms);
        return;
    }
    if ((uint16_t)(now_ms - session.heard_ms) >= SESSION_TIMEOUT_MS) {
        session.number = 0;
        return;
    }
    if (session.welcome) // the first frame of a session is its welcome
        return;
    for (uint8_t radio = 0; radio < RADIOS; radio++)
        to_radio_tell(&to_radio[radio], radio, usb_out(), now_ms);
}
