/*
 * The board of QEMU: mps2-an386, a Cortex-M4F at 25 MHz.
 *
 * The board has no CAN. Frames of the car come from the recorded trace, at each tick those of its cycle. Sent frames are written as
 * text to UART 0, one a line. The program ends QEMU by semihosting; without a debugger that instruction is a fault, so that another
 * board needs its own board_end().
 */
#include "board.h"
#include "firmware_config.h"
#include "report.h"
#include "startup.h"
#include "trace.h"

/* Arm DAI 0386 "Application Note AN386", memory map; CMSDK UART: Arm DDI 0479. */
typedef struct {
    volatile uint32_t data;
    volatile uint32_t state; /* bit 0: the transmitter is full */
    volatile uint32_t control; /* bit 0: transmitter on */
    volatile uint32_t interrupt;
    volatile uint32_t divider;
} uart_t;

/* ARMv7-M Architecture Reference Manual, B3.3. */
typedef struct {
    volatile uint32_t control; /* bits 0 on, 1 exception, 2 clock of the processor */
    volatile uint32_t reload;
    volatile uint32_t value;
} systick_t;

#define UART0 ((uart_t *)0x40004000u)
#define SYSTICK ((systick_t *)0xE000E010u)

enum {
    UART_DIVIDER = 217, /* 115200 baud of 25 MHz */
    SEMIHOSTING_EXIT_EXTENDED = 0x20,
    SEMIHOSTING_APPLICATION_EXIT = 0x20026
};

static volatile uint32_t ticks; /* since board_init() */
static uint32_t ticks_seen;
static uint32_t cycles; /* started */
static uint32_t next_frame; /* of the trace */

static void uart_init(void)
{
    UART0->divider = (uint32_t)UART_DIVIDER;
    UART0->control = 1u;
}

static void uart_write(const char *text)
{
    uint32_t at;

    for (at = 0u; text[at] != '\0'; at++) {
        while ((UART0->state & 1u) != 0u) {
            /* wait for the transmitter */
        }
        UART0->data = (uint32_t)(unsigned char)text[at];
    }
}

void systick_handler(void)
{
    ticks++;
}

void board_init(void)
{
    uart_init();
    SYSTICK->reload = (uint32_t)SYSTICK_RELOAD;
    SYSTICK->value = 0u;
    SYSTICK->control = 7u;
}

/* A tick between check and sleep must not be missed: interrupts are masked, and WFI still wakes on a pending one. */
uint32_t board_wait_for_tick(void)
{
    uint32_t passed = 0u;

    if (cycles < (uint32_t)TRACE_CYCLES) {
        __asm volatile("cpsid i" ::: "memory");
        while (ticks == ticks_seen) {
            __asm volatile("wfi\n cpsie i\n isb\n cpsid i" ::: "memory");
        }
        passed = ticks - ticks_seen;
        ticks_seen = ticks;
        __asm volatile("cpsie i" ::: "memory");
        cycles++;
    }
    return passed;
}

bool board_can_receive(board_frame_t *frame)
{
    const bool is_pending = (next_frame < (uint32_t)TRACE_FRAMES) && ((uint32_t)trace[next_frame].cycle < cycles);
    uint32_t at;

    if (is_pending) {
        const trace_frame_t *const recorded = &trace[next_frame];

        frame->id = recorded->id;
        frame->length = recorded->length;
        for (at = 0u; at < sizeof frame->data; at++) {
            frame->data[at] = recorded->data[at];
        }
        next_frame++;
    }
    return is_pending;
}

void board_can_transmit(const board_frame_t *frame)
{
    report_t line;
    uint32_t at;

    report_init(&line);
    report_hex(&line, frame->id, IDENTIFIER_DIGITS);
    report_text(&line, "#");
    for (at = 0u; at < frame->length; at++) {
        report_hex(&line, frame->data[at], 2u);
    }
    report_text(&line, "\n");
    uart_write(line.text);
}

/* SYS_EXIT_EXTENDED of Arm's semihosting. */
static void exit_emulator(int code)
{
    const uint32_t reason[2] = { (uint32_t)SEMIHOSTING_APPLICATION_EXIT, (uint32_t)code };
    register uint32_t operation __asm("r0") = (uint32_t)SEMIHOSTING_EXIT_EXTENDED;
    register const uint32_t *argument __asm("r1") = reason;

    __asm volatile("bkpt 0xAB" : "+r"(operation) : "r"(argument) : "memory");
}

void board_end(const char *report, int code)
{
    uart_init(); /* a fault can occur before board_init() */
    uart_write(report);
    exit_emulator(code);
    for (;;) {
        /* not reached */
    }
}
