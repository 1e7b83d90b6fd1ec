/*
 * What the program needs of the board. For another one, write these five functions.
 */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stdint.h>

/* A classical CAN frame with an 11-bit identifier. */
typedef struct {
    uint32_t id;
    uint8_t length;
    uint8_t data[8];
} board_frame_t;

/* Start the clocks, CAN, and the timer, which ticks once each period of the task from now on. */
void board_init(void);

/*
 * Sleeps until the next tick, if none came since the call before.
 *
 * Returns the ticks since then: 1 on time, more where the program came late. 0: the recorded trace is over; never in a car.
 */
uint32_t board_wait_for_tick(void);

/* The next frame that waits. Returns false, and leaves frame alone, where there is none. */
bool board_can_receive(board_frame_t *frame);

/* Sends a frame; does not wait for the bus. */
void board_can_transmit(const board_frame_t *frame);

/*
 * The end: of the trace, or by a fault. Also called from fault handlers, and before board_init().
 *
 * In a car: actuator off, error memory, reset. code: 0 where all is well.
 */
__attribute__((noreturn)) void board_end(const char *report, int code);

#endif /* BOARD_H */
