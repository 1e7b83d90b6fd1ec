/*
 * Interface of the board. For another board, write these five functions.
 */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware_config.h"

/* A data frame of the kind in firmware_config.h. */
typedef struct {
    uint32_t id;
    uint8_t length;
    uint8_t data[CAN_FRAME_BYTES];
} board_frame_t;

/* Start the clocks, CAN, and the timer, which ticks once each period of the task from now on. */
void board_init(void);

/*
 * Sleep until the next tick, unless there was one since the previous call.
 *
 * Returns the ticks since then: 1 on time, more if the program is late, 0 at the end of the recorded trace (never in a car).
 */
uint32_t board_wait_for_tick(void);

/* Read the next pending frame. Returns false, and does not change *frame, if there is none. */
bool board_can_receive(board_frame_t *frame);

/* Send a frame without waiting for the bus. */
void board_can_transmit(const board_frame_t *frame);

/*
 * End the program, after the trace or a fault. Also called from fault handlers, and before board_init().
 *
 * In a car: actuator off, error memory, reset. code: 0 without a fault.
 */
__attribute__((noreturn)) void board_end(const char *report, int code);

#endif /* BOARD_H */
