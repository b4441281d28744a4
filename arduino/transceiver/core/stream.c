#include "stream.h"

#define GAP_MS 2u // two characters at 9600: the radio has paused
#define AGE_MS 5u // nothing waits longer for more
#define TELL_AFTER_MS 2u
#define TELL_AFTER_BYTES (WINDOW_BYTES / 3u)
#define LARGEST_WINDOW 0x8000u
#define MOVED_PER_TURN 24u
#define ANSWER_ROOM 48u // left free in the ring for answers, so that they need not wait behind data

_Static_assert((RADIO_TO_HOST_BYTES & (RADIO_TO_HOST_BYTES - 1u)) == 0, "an offset's low bits are its place");
_Static_assert((HOST_TO_RADIO_BYTES & (HOST_TO_RADIO_BYTES - 1u)) == 0, "an offset's low bits are its place");

static uint16_t distance(uint16_t from, uint16_t to) { return (uint16_t)(to - from); }

static uint16_t smaller(uint16_t a, uint16_t b) { return a < b ? a : b; }

// ---- radio to host

void to_host_reset(struct to_host *stream)
{
    stream->acknowledged = stream->sent = stream->head = stream->limit = 0;
    stream->has_gap = false;
}

bool to_host_put(struct to_host *stream, uint8_t byte, uint16_t now_ms)
{
    uint16_t used = distance(stream->acknowledged, stream->head);
    if (used >= RADIO_TO_HOST_BYTES)
        return false;
    if (stream->sent == stream->head)
        stream->first_ms = now_ms;
    stream->last_ms = now_ms;
    stream->bytes[stream->head % RADIO_TO_HOST_BYTES] = byte;
    stream->head++;
    if (used >= stream->high_water)
        stream->high_water = (uint16_t)(used + 1u);
    return true;
}

static void send_again(struct to_host *stream, uint16_t now_ms)
{
    stream->resent = (uint16_t)(stream->resent + distance(stream->acknowledged, stream->sent));
    stream->sent = stream->acknowledged;
    stream->progress_ms = now_ms;
}

// The host reports a gap with each frame that comes behind it; the first report is enough.
static void fill_gap(struct to_host *stream, uint16_t now_ms)
{
    if (stream->has_gap && stream->gap == stream->acknowledged)
        return;
    stream->has_gap = true;
    stream->gap = stream->acknowledged;
    send_again(stream, now_ms);
}

void to_host_acknowledge(struct to_host *stream, const struct acknowledge *frame, uint16_t now_ms)
{
    uint16_t received = frame->received;
    uint16_t limit = frame->limit;
    uint16_t advance = distance(stream->acknowledged, received);
    if (advance > distance(stream->acknowledged, stream->head))
        return;
    if (advance > distance(stream->acknowledged, stream->sent)) // it was sent before it was sent again
        stream->sent = received;
    stream->acknowledged = received;
    if (advance) {
        stream->progress_ms = now_ms;
        stream->has_gap = false;
    }
    if (frame->missing)
        fill_gap(stream, now_ms);
    if (distance(received, limit) <= LARGEST_WINDOW)
        stream->limit = limit;
}

static void go_back(struct to_host *stream, uint16_t now_ms)
{
    if (stream->sent != stream->acknowledged && distance(stream->progress_ms, now_ms) >= RETRY_AFTER_MS)
        send_again(stream, now_ms);
}

static uint8_t ready(const struct to_host *stream, uint16_t now_ms)
{
    uint16_t waiting = distance(stream->sent, stream->head);
    uint16_t window = distance(stream->sent, stream->limit);
    if (window > LARGEST_WINDOW)
        return 0;
    if (waiting < MAX_DATA_BYTES && distance(stream->last_ms, now_ms) < GAP_MS &&
        distance(stream->first_ms, now_ms) < AGE_MS)
        return 0; // more is about to come
    return (uint8_t)smaller(smaller(waiting, window), MAX_DATA_BYTES);
}

void to_host_send(struct to_host *stream, uint8_t radio, struct ring *usb, uint16_t now_ms)
{
    go_back(stream, now_ms);
    uint8_t size = ready(stream, now_ms);
    if (size == 0 || ring_room(usb) < MAX_FRAME_BYTES + ANSWER_ROOM)
        return;
    uint8_t data[MAX_DATA_BYTES];
    for (uint8_t i = 0; i < size; i++)
        data[i] = stream->bytes[(uint16_t)(stream->sent + i) % RADIO_TO_HOST_BYTES];
    struct data head = {radio, stream->sent};
    if (!frame_write(usb, FRAME_DATA, &head, sizeof head, data, size))
        return;
    if (stream->sent == stream->acknowledged)
        stream->progress_ms = now_ms;
    stream->sent = (uint16_t)(stream->sent + size);
    stream->first_ms = now_ms;
}

// ---- host to radio

void to_radio_reset(struct to_radio *stream)
{
    stream->received = stream->tail = stream->told_received = stream->told_limit = 0;
    stream->tell = true;
    stream->missing = false;
}

bool to_radio_is_empty(const struct to_radio *stream) { return stream->received == stream->tail; }

void to_radio_receive(struct to_radio *stream, uint16_t offset, const uint8_t *data, uint8_t size)
{
    uint16_t known = distance(offset, stream->received);
    uint16_t used = distance(stream->tail, stream->received);
    if (known >= size || (uint16_t)(size - known) > HOST_TO_RADIO_BYTES - used) {
        stream->tell = true; // it came twice, something before it is missing, or there was no room: say what is here
        stream->missing = known > LARGEST_WINDOW;
        return;
    }
    for (uint8_t i = (uint8_t)known; i < size; i++)
        stream->bytes[stream->received++ % HOST_TO_RADIO_BYTES] = data[i];
    used = distance(stream->tail, stream->received);
    if (used > stream->high_water)
        stream->high_water = used;
}

bool to_radio_move(struct to_radio *stream, struct ring *radio)
{
    uint16_t count = smaller(distance(stream->tail, stream->received), MOVED_PER_TURN);
    count = smaller(count, ring_room(radio));
    for (uint16_t n = count; n; n--)
        ring_put(radio, stream->bytes[stream->tail++ % HOST_TO_RADIO_BYTES]);
    return count != 0;
}

static bool is_news(const struct to_radio *stream, uint16_t limit, uint16_t now_ms)
{
    uint16_t bytes = distance(stream->told_received, stream->received);
    return stream->tell || bytes >= TELL_AFTER_BYTES || distance(stream->told_limit, limit) >= TELL_AFTER_BYTES ||
           (bytes && distance(stream->told_ms, now_ms) >= TELL_AFTER_MS);
}

void to_radio_tell(struct to_radio *stream, uint8_t radio, struct ring *usb, uint16_t now_ms)
{
    uint16_t room = (uint16_t)(HOST_TO_RADIO_BYTES - distance(stream->tail, stream->received));
    uint16_t limit = (uint16_t)(stream->received + smaller(room, WINDOW_BYTES));
    if (!is_news(stream, limit, now_ms))
        return;
    struct acknowledge body = {radio, stream->received, limit, stream->missing};
    if (!frame_write(usb, FRAME_ACKNOWLEDGE, &body, sizeof body, 0, 0))
        return;
    stream->told_received = stream->received;
    stream->told_limit = limit;
    stream->told_ms = now_ms;
    stream->tell = stream->missing = false;
}
