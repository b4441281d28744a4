// A serial port of this machine: a pseudo-terminal under a name of our choice.
#pragma once

#include <stdbool.h>

#include "mcu.h"

struct terminal {
    const char *link; // the name: a symbolic link
    int fd;           // -1: unplugged
    bool is_open;     // somebody has it open
};

bool terminal_plug(struct terminal *terminal);
void terminal_unplug(struct terminal *terminal);

// Bytes both ways, without waiting. True when somebody has just opened it: a Mega's USB chip then resets the processor.
bool terminal_exchange(struct terminal *terminal, struct mcu_port *port);
