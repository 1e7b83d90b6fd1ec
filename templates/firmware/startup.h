/*
 * From reset to main(), and what went wrong on the way.
 */
#ifndef STARTUP_H
#define STARTUP_H

#include <stdbool.h>
#include <stdint.h>

/* In the vector table, defined by the board. */
void systick_handler(void);

/* Whether the FPU has computed something for this thread (CONTROL.FPCA). */
bool startup_fpu_was_used(void);

/* Bytes of the thread's stack that were ever used. */
uint32_t startup_stack_used(void);

#endif /* STARTUP_H */
