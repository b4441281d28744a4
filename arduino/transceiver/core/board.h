// What the core asks of the board. `board/` has the Mega, `host/` a library for tests.
#pragma once

#include <stdbool.h>
#include <stdint.h>

uint16_t board_now_ms(void);
uint16_t board_now_4us(void); // for the length of a loop
void board_send(uint8_t port); // there are bytes in the port's ring
bool board_is_idle(uint8_t port); // the last stop bit has left
bool board_set_baud(uint8_t port, uint32_t baud); // false: not a rate of this board
void board_reset_radio(uint8_t radio, bool low);
void board_rest(void); // until the next interrupt, unless bytes have come in; the clock's comes every millisecond
void board_enter_task(uint8_t task); // remembered beyond a reset: the last one entered is the one that hung
uint16_t board_free_ram(void); // bytes the stack never touched
bool board_stack_is_whole(void); // it has not grown into the variables
void board_feed_watchdog(void);
void board_stop(uint8_t cause, uint8_t detail); // records the reason and resets; does not return on a Mega
