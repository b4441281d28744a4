// Bytes between one interrupt and the main loop: one side puts, the other takes, and neither switches interrupts off.
#pragma once

#include <stdbool.h>
#include <stdint.h>

#define RING_CAPACITY 255u

struct ring {
    volatile uint8_t head; // moved by the side that puts
    volatile uint8_t tail; // moved by the side that takes
    uint8_t bytes[RING_CAPACITY + 1u];
};

// The byte must be in memory before the index says so.
#define RING_BARRIER() __asm__ volatile("" ::: "memory")

static inline uint8_t ring_used(const struct ring *ring) { return (uint8_t)(ring->head - ring->tail); }

static inline uint8_t ring_room(const struct ring *ring) { return (uint8_t)(RING_CAPACITY - ring_used(ring)); }

// False, and nothing done, when the ring is full.
static inline bool ring_put(struct ring *ring, uint8_t byte)
{
    uint8_t head = ring->head;
    if ((uint8_t)(head + 1u) == ring->tail)
        return false;
    ring->bytes[head] = byte;
    RING_BARRIER();
    ring->head = (uint8_t)(head + 1u);
    return true;
}

// The ring must not be empty.
static inline uint8_t ring_take(struct ring *ring)
{
    uint8_t tail = ring->tail;
    uint8_t byte = ring->bytes[tail];
    RING_BARRIER();
    ring->tail = (uint8_t)(tail + 1u);
    return byte;
}
