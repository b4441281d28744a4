// Counters, what the host is told of them, and who feeds the watchdog.
#pragma once

#include "protocol_gen.h"

void health_init(uint16_t now_ms);
void health_frame_in(void);
void health_count(uint8_t fault, uint8_t port, uint16_t more);
void health_radio_in(uint8_t radio, uint16_t bytes);
void health_tell(void); // the answer to a ping
void health_loop(uint16_t now_ms, uint16_t loop_4us); // once per loop: high-water marks, uptime, the interrupts' counters
void health_task(uint16_t now_ms);
void supervisor_task(uint16_t now_ms);
