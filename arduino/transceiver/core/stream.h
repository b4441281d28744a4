// The bytes of one radio, numbered by their offset since the session began, modulo 65536. The receiver acknowledges
// and says up to which offset it has room; what is not acknowledged is sent again. So a damaged frame loses nothing,
// a frame that comes twice does no harm, and no side can be overrun.
#pragma once

#include "frame.h"

struct to_host {
    uint8_t bytes[RADIO_TO_HOST_BYTES];
    uint16_t acknowledged;
    uint16_t sent;
    uint16_t head;
    uint16_t limit;
    uint16_t high_water;
    uint16_t resent;
    uint16_t first_ms; // arrival of the oldest byte that was not sent
    uint16_t last_ms;
    uint16_t progress_ms; // last acknowledgement or first sending
    uint16_t gap; // the last that was reported missing and sent again for it
    bool has_gap;
};

struct to_radio {
    uint8_t bytes[HOST_TO_RADIO_BYTES];
    uint16_t received;
    uint16_t tail;
    uint16_t high_water;
    uint16_t told_received; // what the host knows
    uint16_t told_limit;
    uint16_t told_ms;
    bool tell;
    bool missing; // something later came before what is due
};

void to_host_reset(struct to_host *stream);
bool to_host_put(struct to_host *stream, uint8_t byte, uint16_t now_ms); // false: full
void to_host_acknowledge(struct to_host *stream, const struct acknowledge *frame, uint16_t now_ms);
void to_host_send(struct to_host *stream, uint8_t radio, struct ring *usb, uint16_t now_ms);

void to_radio_reset(struct to_radio *stream);
void to_radio_receive(struct to_radio *stream, uint16_t offset, const uint8_t *data, uint8_t size);
bool to_radio_move(struct to_radio *stream, struct ring *radio); // true: something moved
bool to_radio_is_empty(const struct to_radio *stream);
void to_radio_tell(struct to_radio *stream, uint8_t radio, struct ring *usb, uint16_t now_ms);
