// Frames on USB: number, body, CRC-16, stuffed by COBS so that a zero ends a frame and stands nowhere else.
#pragma once

#include "protocol_gen.h"
#include "ring.h"

#define MAX_CONTENT_BYTES (1u + MAX_BODY_BYTES + 2u)
#define MAX_FRAME_BYTES (1u + MAX_CONTENT_BYTES + 1u) // one length byte: contents are shorter than 254
_Static_assert(MAX_CONTENT_BYTES < 254, "one length byte is enough");
_Static_assert(MAX_FRAME_BYTES < RING_CAPACITY, "a frame fits into the ring");

struct frame_reader {
    uint8_t content[MAX_CONTENT_BYTES];
    uint8_t length;
    uint8_t left; // bytes of the current run
    uint16_t crc;
    bool in_frame;
    bool bad;
};

enum frame_event { FRAME_NONE, FRAME_READY, FRAME_DAMAGED };

void frame_reader_init(struct frame_reader *reader);

// After FRAME_READY the content without its CRC is in `content`, `length` long, until the next byte.
enum frame_event frame_read(struct frame_reader *reader, uint8_t byte);

// One frame of a number, a head and data behind it; false, and nothing done, when the ring has no room for it.
bool frame_write(struct ring *ring, uint8_t number, const void *head, uint8_t head_size, const uint8_t *data,
                 uint8_t data_size);
