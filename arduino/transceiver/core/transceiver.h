// The transceiver between USB and two radios: a list of tasks that take a little each and never wait.
#pragma once

#include <stdint.h>

void transceiver_init(uint8_t reset_cause, uint8_t reset_detail);

// All tasks once; called for ever.
void transceiver_loop(void);
