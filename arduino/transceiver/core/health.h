// Counters, what the host is told of them, and who feeds the watchdog.
#pragma once

#include "protocol_gen.h"

#define RING_IN(port) ((uint8_t)(2u * (port)))
#define RING_OUT(port) ((uint8_t)(2u * (port) + 1u))

void health_init(uint16_t now_ms);
void health_frame_in(void);
void health_count(uint8_t fault, uint8_t port, uint16_t more);
void health_radio_in(uint8_t radio, uint16_t bytes);
void health_tell(void); // the answer to a ping
void health_mark(uint8_t ring, uint8_t used); // how full a ring was when it was fullest
void health_loop_took(uint16_t loop_4us);
void health_task(uint16_t now_ms);
void supervisor_task(uint16_t now_ms);
