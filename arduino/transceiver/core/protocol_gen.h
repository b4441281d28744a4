// Written by tools/gen_protocol.py from shared/protocol/transceiver.py; change that and run `make firmware`.
#pragma once

#include <stdint.h>

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "numbers lie in memory as on the wire");

#define PROTOCOL_FINGERPRINT 0x9CEAu
#define FIRMWARE_MAJOR 1u
#define FIRMWARE_MINOR 0u
#define USB_BAUD 500000ul
#define DEFAULT_RADIO_BAUD 115200ul
#define RADIOS 2u
#define MAX_DATA_BYTES 64u
#define MAX_BODY_BYTES 67u
#define RADIO_TO_HOST_BYTES 2048u
#define HOST_TO_RADIO_BYTES 256u
#define WINDOW_BYTES 96u
#define ANNOUNCE_EVERY_MS 250u
#define SESSION_TIMEOUT_MS 1500u
#define RETRY_AFTER_MS 60u
#define MAX_RESET_MS 1000u
#define FOR_EACH_RADIO_BAUD(RATE) RATE(9600ul) RATE(19200ul) RATE(38400ul) RATE(57600ul) RATE(115200ul)

enum frame_number {
    FRAME_ANNOUNCE = 0x01,
    FRAME_HELLO = 0x02,
    FRAME_WELCOME = 0x03,
    FRAME_REFUSE = 0x04,
    FRAME_GOODBYE = 0x05,
    FRAME_DATA = 0x10,
    FRAME_ACKNOWLEDGE = 0x11,
    FRAME_PING = 0x20,
    FRAME_SET_BAUD = 0x21,
    FRAME_RESET_RADIO = 0x22,
    FRAME_DONE = 0x23,
    FRAME_HEALTH = 0x30,
    FRAME_RADIO_HEALTH = 0x31,
    FRAME_FAULT_REPORT = 0x32,
};

enum reset_cause {
    RESET_CAUSE_POWER_ON = 0,
    RESET_CAUSE_RESET_PIN = 1,
    RESET_CAUSE_BROWN_OUT = 2,
    RESET_CAUSE_HUNG = 3,
    RESET_CAUSE_RING_STUCK = 4,
    RESET_CAUSE_STACK_OVERFLOW = 5,
    RESET_CAUSE_BAD_INTERRUPT = 6,
    RESET_CAUSE_COUNT = 7,
};

enum task {
    TASK_FROM_HOST = 0,
    TASK_TO_RADIO = 1,
    TASK_FROM_RADIO = 2,
    TASK_TO_HOST = 3,
    TASK_COMMAND = 4,
    TASK_SESSION = 5,
    TASK_HEALTH = 6,
    TASK_SUPERVISOR = 7,
    TASK_REST = 8,
    TASK_COUNT = 9,
};

enum port {
    PORT_USB = 0,
    PORT_RADIO_A = 1,
    PORT_RADIO_B = 2,
    PORT_COUNT = 3,
};

enum fault {
    FAULT_FRAMING = 0,
    FAULT_OVERRUN = 1,
    FAULT_RING_FULL = 2,
    FAULT_STREAM_FULL = 3,
    FAULT_BAD_FRAME = 4,
    FAULT_COUNT = 5,
};

enum result {
    RESULT_DONE = 0,
    RESULT_BAD_VALUE = 1,
    RESULT_COUNT = 2,
};

struct __attribute__((packed)) announce {
    uint16_t fingerprint;
    uint8_t major;
    uint8_t minor;
    uint8_t reset_cause;
    uint8_t reset_detail;
};
_Static_assert(sizeof(struct announce) == 6, "announce is packed");

struct __attribute__((packed)) hello {
    uint16_t fingerprint;
    uint32_t session;
};
_Static_assert(sizeof(struct hello) == 6, "hello is packed");

struct __attribute__((packed)) welcome {
    uint32_t session;
    uint8_t major;
    uint8_t minor;
    uint8_t reset_cause;
    uint8_t reset_detail;
};
_Static_assert(sizeof(struct welcome) == 8, "welcome is packed");

struct __attribute__((packed)) refuse {
    uint16_t fingerprint;
};
_Static_assert(sizeof(struct refuse) == 2, "refuse is packed");

struct __attribute__((packed)) data {
    uint8_t radio;
    uint16_t offset;
};
_Static_assert(sizeof(struct data) == 3, "data is packed");

struct __attribute__((packed)) acknowledge {
    uint8_t radio;
    uint16_t received;
    uint16_t limit;
    uint8_t missing;
};
_Static_assert(sizeof(struct acknowledge) == 6, "acknowledge is packed");

struct __attribute__((packed)) ping {
    uint8_t wants_health;
};
_Static_assert(sizeof(struct ping) == 1, "ping is packed");

struct __attribute__((packed)) set_baud {
    uint8_t tag;
    uint8_t radio;
    uint32_t baud;
};
_Static_assert(sizeof(struct set_baud) == 6, "set_baud is packed");

struct __attribute__((packed)) reset_radio {
    uint8_t tag;
    uint8_t radio;
    uint16_t low_ms;
};
_Static_assert(sizeof(struct reset_radio) == 4, "reset_radio is packed");

struct __attribute__((packed)) done {
    uint8_t tag;
    uint8_t result;
};
_Static_assert(sizeof(struct done) == 2, "done is packed");

struct __attribute__((packed)) health {
    uint32_t uptime_ms;
    uint8_t reset_cause;
    uint8_t reset_detail;
    uint16_t free_ram_bytes;
    uint16_t longest_loop_us;
    uint32_t frames_in;
    uint16_t usb_bad_frames;
    uint16_t usb_framing;
    uint16_t usb_overrun;
    uint16_t usb_ring_full;
    uint8_t usb_in_high_water;
    uint8_t usb_out_high_water;
};
_Static_assert(sizeof(struct health) == 24, "health is packed");

struct __attribute__((packed)) radio_health {
    uint8_t radio;
    uint32_t baud;
    uint32_t bytes_in;
    uint32_t bytes_out;
    uint16_t resent_bytes;
    uint16_t framing;
    uint16_t overrun;
    uint16_t ring_full;
    uint16_t stream_full;
    uint8_t ring_in_high_water;
    uint16_t to_host_high_water;
    uint16_t to_radio_high_water;
};
_Static_assert(sizeof(struct radio_health) == 28, "radio_health is packed");

struct __attribute__((packed)) fault_report {
    uint8_t fault;
    uint8_t port;
    uint16_t total;
};
_Static_assert(sizeof(struct fault_report) == 4, "fault_report is packed");
