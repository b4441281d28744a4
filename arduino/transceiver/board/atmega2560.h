// The Mega: what happens before and around the core.
#pragma once

#include <stdint.h>

struct reset {
    uint8_t cause;
    uint8_t detail;
};

struct reset board_init(void);
