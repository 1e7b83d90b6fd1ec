/*
 * Startup code and fault handlers.
 */
#ifndef STARTUP_H
#define STARTUP_H

#include <stdbool.h>
#include <stdint.h>

/* Handler of the timer, defined by the board. */
void systick_handler(void);

/* Return whether this thread has used the FPU (CONTROL.FPCA). */
bool startup_fpu_was_used(void);

/* Return the largest use of the thread's stack so far, in bytes. */
uint32_t startup_stack_used(void);

#endif /* STARTUP_H */
