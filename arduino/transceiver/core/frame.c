#include "frame.h"

#include "crc16.h"

#define CRC_BYTES 2u

static void begin(struct frame_reader *reader)
{
    reader->length = 0;
    reader->left = 0;
    reader->crc = CRC16_START;
    reader->in_frame = false;
    reader->bad = false;
}

void frame_reader_init(struct frame_reader *reader) { begin(reader); }

static void collect(struct frame_reader *reader, uint8_t byte)
{
    if (reader->length >= MAX_CONTENT_BYTES) {
        reader->bad = true;
        return;
    }
    reader->content[reader->length++] = byte;
    reader->crc = crc16(reader->crc, byte);
}

static enum frame_event finish(struct frame_reader *reader)
{
    uint8_t length = reader->length;
    bool empty = !reader->in_frame;
    bool good = !reader->bad && reader->left == 0 && reader->crc == 0 && length > CRC_BYTES;
    begin(reader);
    if (empty)
        return FRAME_NONE;
    if (!good)
        return FRAME_DAMAGED;
    reader->length = (uint8_t)(length - CRC_BYTES);
    return FRAME_READY;
}

enum frame_event frame_read(struct frame_reader *reader, uint8_t byte)
{
    if (byte == 0)
        return finish(reader);
    if (!reader->in_frame) {
        begin(reader);
        reader->in_frame = true;
        reader->left = (uint8_t)(byte - 1u);
    } else if (reader->left == 0) { // a length byte stands where a zero was
        collect(reader, 0);
        reader->left = (uint8_t)(byte - 1u);
    } else {
        collect(reader, byte);
        reader->left--;
    }
    return FRAME_NONE;
}

// Puts bytes behind a length byte that is filled in when the run is over. The reader's interrupt must not see the
// frame before: `head` of the ring moves once, at the end.
struct writer {
    uint8_t *bytes;
    uint8_t run; // where the length byte of the current run is
    uint8_t at;
    uint16_t crc;
};

static void stuff(struct writer *writer, uint8_t byte)
{
    if (byte == 0) {
        writer->bytes[writer->run] = (uint8_t)(writer->at - writer->run);
        writer->run = writer->at;
    } else {
        writer->bytes[writer->at] = byte;
    }
    writer->at++;
}

static void write_bytes(struct writer *writer, const uint8_t *bytes, uint8_t size)
{
    for (uint8_t i = 0; i < size; i++) {
        writer->crc = crc16(writer->crc, bytes[i]);
        stuff(writer, bytes[i]);
    }
}

bool frame_write(struct ring *ring, uint8_t number, const void *head, uint8_t head_size, const uint8_t *data,
                 uint8_t data_size)
{
    if (ring_room(ring) < 1u + 1u + head_size + data_size + CRC_BYTES + 1u)
        return false;
    struct writer writer = {ring->bytes, ring->head, (uint8_t)(ring->head + 1u), CRC16_START};
    write_bytes(&writer, &number, 1);
    write_bytes(&writer, head, head_size);
    write_bytes(&writer, data, data_size);
    uint16_t crc = writer.crc;
    stuff(&writer, (uint8_t)(crc & 0xFFu));
    stuff(&writer, (uint8_t)(crc >> 8));
    writer.bytes[writer.run] = (uint8_t)(writer.at - writer.run);
    writer.bytes[writer.at++] = 0;
    RING_BARRIER();
    ring->head = writer.at;
    return true;
}
