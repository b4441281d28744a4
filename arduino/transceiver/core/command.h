// Commands of the host: one at a time, each carried out once however often it comes, each answered by its tag.
#pragma once

#include "protocol_gen.h"

void command_init(void);
void command_forget(void); // a new session numbers its commands anew
void command_set_baud(const struct set_baud *command);
void command_reset_radio(const struct reset_radio *command, uint16_t now_ms);
void command_task(uint16_t now_ms);
uint32_t command_baud(uint8_t radio);
