#define _GNU_SOURCE
#include "terminal.h"

#include <fcntl.h>
#include <poll.h>
#include <pty.h>
#include <stdio.h>
#include <termios.h>
#include <unistd.h>

bool terminal_plug(struct terminal *terminal)
{
    int slave;
    char name[128];
    struct termios settings;
    if (openpty(&terminal->fd, &slave, name, NULL, NULL))
        return false;
    tcgetattr(slave, &settings);
    cfmakeraw(&settings);
    tcsetattr(slave, TCSANOW, &settings);
    close(slave); // so that the master can tell whether somebody has it open
    fcntl(terminal->fd, F_SETFL, O_NONBLOCK);
    terminal->is_open = false;
    unlink(terminal->link);
    return symlink(name, terminal->link) == 0;
}

void terminal_unplug(struct terminal *terminal)
{
    if (terminal->fd < 0)
        return;
    unlink(terminal->link);
    close(terminal->fd);
    terminal->fd = -1;
    terminal->is_open = false;
}

static void write_out(struct terminal *terminal, struct queue *out)
{
    ssize_t written = write(terminal->fd, out->bytes, out->count);
    if (written > 0)
        queue_drop(out, (size_t)written);
}

static void read_in(struct terminal *terminal, struct queue *in)
{
    size_t room = QUEUE_BYTES - in->count; // what is not fetched waits in the terminal, whose writer waits
    ssize_t got = room ? read(terminal->fd, in->bytes + in->count, room) : 0;
    if (got > 0)
        in->count += (size_t)got;
}

bool terminal_exchange(struct terminal *terminal, struct mcu_port *port)
{
    struct pollfd state = {terminal->fd, POLLIN, 0};
    if (terminal->fd < 0 || poll(&state, 1, 0) < 0) {
        port->out.count = 0;
        return false;
    }
    bool is_open = !(state.revents & POLLHUP);
    bool opened = is_open && !terminal->is_open;
    terminal->is_open = is_open;
    if (state.revents & POLLIN)
        read_in(terminal, &port->in);
    if (is_open)
        write_out(terminal, &port->out);
    else
        port->out.count = 0; // nobody listens
    return opened;
}
