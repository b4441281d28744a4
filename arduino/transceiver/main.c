#include "board/atmega2560.h"
#include "core/board.h"
#include "core/transceiver.h"

int main(void)
{
    struct reset reset = board_init();
    transceiver_init(reset.cause, reset.detail);
    for (;;) {
        transceiver_loop();
        board_rest();
    }
}
