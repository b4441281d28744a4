// mega_host: an Arduino Mega 2560 that runs a firmware's hex, with three serial ports.
//
//   mega_host step FIRMWARE.hex [BOOT_LOADER.hex]
//   mega_host live USB RADIO_A RADIO_B FIRMWARE.hex [BOOT_LOADER.hex]
//
// `step`: time is virtual and moves by the command `run`. `live`: the ports are pseudo-terminals under the names given
// and time is that of the wall. Commands come by lines on standard input, whose end ends the program:
//
//   run US HEX HEX HEX   bytes into the three ports ("-": none), then so many µs; answered by `ran NOW_US HEX HEX HEX`
//   reset | hang | mute PORT
//   unplug | plug        USB, and with it the power
//   ping                 answered by `pong`
//
// Lines on standard output that begin with `event` tell of resets, of rates and of the radios' reset pins.
#define _GNU_SOURCE
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "mcu.h"
#include "terminal.h"

#define SLICE_US 500u
#define MOST_BEHIND_US 200000u // after a longer stall of this machine time goes on from there
#define LINE_BYTES 65536u
#define MOST_RUN_US 60000000u

static struct terminal terminals[PORTS] = {{NULL, -1, false}, {NULL, -1, false}, {NULL, -1, false}};
static bool live, powered = true;

static void fail(const char *what)
{
    fprintf(stderr, "mega_host: %s\n", what);
    exit(2);
}

// ---- commands

static void put_hex(struct queue *queue, const char *hex)
{
    unsigned value;
    for (; hex[0] && hex[1] && sscanf(hex, "%2x", &value) == 1; hex += 2) {
        uint8_t byte = (uint8_t)value;
        queue_put(queue, &byte, 1);
    }
}

static void print_hex(struct queue *queue)
{
    static const char digits[] = "0123456789abcdef";
    putchar(' ');
    if (queue->count == 0)
        putchar('-');
    for (size_t i = 0; i < queue->count; i++) {
        putchar(digits[queue->bytes[i] >> 4]);
        putchar(digits[queue->bytes[i] & 15]);
    }
    queue->count = 0;
}

static void command_run(void)
{
    const char *us = strtok(NULL, " ");
    for (int port = 0; port < PORTS; port++) {
        const char *hex = strtok(NULL, " ");
        if (hex && powered)
            put_hex(&mcu_ports[port].in, hex);
    }
    uint64_t run_us = us ? strtoull(us, NULL, 10) : 0;
    mcu_run(run_us < MOST_RUN_US ? run_us : MOST_RUN_US);
    printf("ran %llu", (unsigned long long)mcu_now_us());
    for (int port = 0; port < PORTS; port++)
        print_hex(&mcu_ports[port].out);
    putchar('\n');
}

static void command_plug(bool plug)
{
    if (plug == powered)
        return;
    powered = plug;
    if (live && plug)
        terminal_plug(&terminals[0]);
    else if (live)
        terminal_unplug(&terminals[0]);
    if (plug)
        mcu_power_cycle();
}

static void carry_out(char *line)
{
    const char *word = strtok(line, " \n");
    if (!word)
        return;
    if (!strcmp(word, "run"))
        command_run();
    else if (!strcmp(word, "reset"))
        mcu_reset();
    else if (!strcmp(word, "hang"))
        mcu_hang();
    else if (!strcmp(word, "mute"))
        mcu_mute(atoi(strtok(NULL, " \n") ?: "0") % PORTS);
    else if (!strcmp(word, "plug"))
        command_plug(true);
    else if (!strcmp(word, "unplug"))
        command_plug(false);
    else if (!strcmp(word, "ping"))
        puts("pong");
    fflush(stdout);
}

// ---- with virtual time

static void step(void)
{
    static char line[4 * LINE_BYTES];
    while (fgets(line, sizeof line, stdin))
        carry_out(line);
}

// ---- with the wall's time

static uint64_t wall_us(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000u + (uint64_t)now.tv_nsec / 1000u;
}

// False at the end of standard input: whoever started this program is gone.
static bool listen(void)
{
    static char line[LINE_BYTES];
    static size_t length;
    struct pollfd input = {STDIN_FILENO, POLLIN, 0};
    while (poll(&input, 1, 0) > 0) {
        char byte;
        if (read(STDIN_FILENO, &byte, 1) <= 0)
            return false;
        if (byte == '\n') {
            line[length] = 0;
            length = 0;
            carry_out(line);
        } else if (length < sizeof line - 1) {
            line[length++] = byte;
        }
    }
    return true;
}

static void exchange(void)
{
    for (int port = 0; port < PORTS; port++)
        if (terminal_exchange(&terminals[port], &mcu_ports[port]) && port == 0)
            mcu_reset(); // DTR
}

static void run_live(void)
{
    uint64_t due_us = wall_us();
    while (listen()) {
        if (powered)
            mcu_run(SLICE_US);
        exchange();
        fflush(stdout);
        due_us += SLICE_US;
        uint64_t now_us = wall_us();
        if (due_us > now_us)
            usleep((useconds_t)(due_us - now_us));
        else if (now_us - due_us > MOST_BEHIND_US)
            due_us = now_us;
    }
    for (int port = 0; port < PORTS; port++)
        terminal_unplug(&terminals[port]);
}

int main(int count, char **words)
{
    if (count < 2)
        fail("see the head of main.c for how to call me");
    live = !strcmp(words[1], "live");
    int firmware = live ? 2 + PORTS : 2;
    if (count <= firmware || count > firmware + 2)
        fail("see the head of main.c for how to call me");
    signal(SIGPIPE, SIG_IGN);
    if (!mcu_open(words[firmware], count > firmware + 1 ? words[firmware + 1] : NULL))
        fail("the firmware is no Intel hex for an ATmega2560");
    for (int port = 0; live && port < PORTS; port++) {
        terminals[port].link = words[2 + port];
        if (!terminal_plug(&terminals[port]))
            fail("a serial port could not be made");
    }
    puts("ready");
    fflush(stdout);
    if (live)
        run_live();
    else
        step();
    return 0;
}
