/*
 * Startup code and fault handlers for any Cortex-M4F.
 *
 * The program runs on its own stack (PSP) at the lower end of the RAM. The memory protection unit, where present, closes the last bytes
 * of it: an overflow is a fault and overwrites nothing. Exceptions use another stack (MSP), so that the fault can be reported.
 *
 * Registers: ARMv7-M Architecture Reference Manual, B3.2 and B3.5.
 */
#include "startup.h"

#include "board.h"
#include "report.h"

#define SCB_VTOR (*(volatile uint32_t *)0xE000ED08u)
#define SCB_CCR (*(volatile uint32_t *)0xE000ED14u)
#define SCB_SHCSR (*(volatile uint32_t *)0xE000ED24u)
#define SCB_CFSR (*(volatile uint32_t *)0xE000ED28u)
#define SCB_HFSR (*(volatile uint32_t *)0xE000ED2Cu)
#define MPU_TYPE (*(const volatile uint32_t *)0xE000ED90u)
#define MPU_CTRL (*(volatile uint32_t *)0xE000ED94u)
#define MPU_RBAR (*(volatile uint32_t *)0xE000ED9Cu)
#define MPU_RASR (*(volatile uint32_t *)0xE000EDA0u)

enum {
    CCR_DIVIDE_BY_ZERO_TRAP = 1 << 4,
    SHCSR_FAULTS_ON = 7 << 16, /* separate memory, bus and usage faults */
    MPU_TYPE_REGIONS = 0xFF << 8,
    MPU_CTRL_ON_WITH_DEFAULT_MAP = 5,
    MPU_RBAR_REGION_0 = 1 << 4,
    MPU_RASR_256_BYTES_CLOSED = (1 << 28) | (7 << 1) | 1, /* no access, no execution */
    FRAME_PC = 6, /* index of the program counter in an exception frame */
    FRAME_BYTES = 32,
    GUARD_WORDS = 64, /* the closed 256 bytes */
    THREAD_STACK_WORDS = GUARD_WORDS + 1024,
    HANDLER_STACK_WORDS = 256,
    EXIT_FAULT = 2
};

/* The linker script places thread_stack at the start of the RAM. Its alignment is the size of the closed bytes; that of the other stack
 * is eight bytes, by the procedure call standard (AAPCS 6.2.1.2). */
__attribute__((aligned(256), section(".bss.thread_stack"), used)) static uint32_t thread_stack[THREAD_STACK_WORDS];
__attribute__((aligned(8))) static uint32_t handler_stack[HANDLER_STACK_WORDS];

/* Symbols of the linker script. */
extern uint32_t data_start[];
extern uint32_t data_end[];
extern const uint32_t data_load[];
extern uint32_t bss_start[];
extern uint32_t bss_end[];

int main(void);
void reset_handler(void);
void fault_handler(void);
__attribute__((noreturn)) void start(void);
__attribute__((noreturn)) void report_fault(const uint32_t *frame);

/* Vector table, B1.5.3. The interrupts of a chip follow the last entry. */
typedef struct {
    uint32_t *stack;
    void (*handler[15])(void);
} vector_table_t;

extern const vector_table_t vector_table;

__attribute__((section(".vectors"), used)) const vector_table_t vector_table = {
    .stack = &handler_stack[HANDLER_STACK_WORDS],
    .handler = {
        reset_handler,
        fault_handler, /* NMI */
        fault_handler, /* hard fault */
        fault_handler, /* memory management */
        fault_handler, /* bus */
        fault_handler, /* usage */
        0,
        0,
        0,
        0,
        fault_handler, /* SVCall */
        fault_handler, /* debug monitor */
        0,
        fault_handler, /* PendSV */
        systick_handler
    }
};

/* Enable the FPU before the compiler can use it: full access to coprocessors 10 and 11 (CPACR). Its reset state rounds to nearest and
 * keeps subnormal numbers, as the reference does. Then fill the thread's stack with a pattern, to measure its use, and switch to it. */
__attribute__((naked, noreturn)) void reset_handler(void)
{
    __asm volatile(
        "ldr r0, =0xE000ED88\n"
        "ldr r1, [r0]\n"
        "orr r1, r1, #0xF00000\n"
        "str r1, [r0]\n"
        "dsb\n"
        "isb\n"
        "ldr r0, =thread_stack_bottom\n"
        "ldr r1, =thread_stack_top\n"
        "ldr r2, =0xA5A5A5A5\n"
        "1: str r2, [r0], #4\n"
        "cmp r0, r1\n"
        "blo 1b\n"
        "msr psp, r1\n"
        "movs r0, #2\n"
        "msr control, r0\n"
        "isb\n"
        "b start\n");
}

static void close_end_of_stack(void)
{
    if ((MPU_TYPE & (uint32_t)MPU_TYPE_REGIONS) != 0u) {
        MPU_RBAR = (uint32_t)(uintptr_t)thread_stack | (uint32_t)MPU_RBAR_REGION_0;
        MPU_RASR = (uint32_t)MPU_RASR_256_BYTES_CLOSED;
        MPU_CTRL = (uint32_t)MPU_CTRL_ON_WITH_DEFAULT_MAP;
    }
}

void start(void)
{
    const uint32_t *from = data_load;
    uint32_t *to;

    for (to = data_start; to < data_end; to++) {
        *to = *from;
        from++;
    }
    for (to = bss_start; to < bss_end; to++) {
        *to = 0u;
    }
    SCB_VTOR = (uint32_t)(uintptr_t)&vector_table;
    SCB_CCR |= (uint32_t)CCR_DIVIDE_BY_ZERO_TRAP;
    SCB_SHCSR |= (uint32_t)SHCSR_FAULTS_ON;
    close_end_of_stack();
    __asm volatile("dsb\n isb" ::: "memory");
    (void)main();
    board_end("main returned\n", EXIT_FAULT);
}

/* Bit 2 of the link register selects the stack with the exception frame (B1.5.8). */
__attribute__((naked)) void fault_handler(void)
{
    __asm volatile(
        "tst lr, #4\n"
        "ite eq\n"
        "mrseq r0, msp\n"
        "mrsne r0, psp\n"
        "b report_fault\n");
}

/* Return whether an exception frame is inside a stack. */
static bool is_inside(const uint32_t *frame, const uint32_t *bottom, const uint32_t *top)
{
    return ((uintptr_t)frame >= (uintptr_t)bottom) && (((uintptr_t)frame + (uintptr_t)FRAME_BYTES) <= (uintptr_t)top);
}

void report_fault(const uint32_t *frame)
{
    uint32_t exception;
    report_t line;

    __asm volatile("mrs %0, ipsr" : "=r"(exception));
    report_init(&line);
    report_text(&line, "fault:");
    report_value(&line, "exception", exception);
    report_text(&line, " cfsr=0x");
    report_hex(&line, SCB_CFSR, 8u);
    report_text(&line, " hfsr=0x");
    report_hex(&line, SCB_HFSR, 8u);
    if (is_inside(frame, &thread_stack[GUARD_WORDS], &thread_stack[THREAD_STACK_WORDS])
        || is_inside(frame, handler_stack, &handler_stack[HANDLER_STACK_WORDS])) {
        report_text(&line, " pc=0x");
        report_hex(&line, frame[FRAME_PC], 8u);
    } else {
        report_text(&line, " stack overflow");
    }
    report_text(&line, "\n");
    board_end(line.text, EXIT_FAULT);
}

bool startup_fpu_was_used(void)
{
    uint32_t control;

    __asm volatile("mrs %0, control" : "=r"(control));
    return (control & 4u) != 0u;
}

uint32_t startup_stack_used(void)
{
    const volatile uint32_t *const words = thread_stack;
    uint32_t at = (uint32_t)GUARD_WORDS;

    while ((at < (uint32_t)THREAD_STACK_WORDS) && (words[at] == 0xA5A5A5A5u)) {
        at++;
    }
    return 4u * ((uint32_t)THREAD_STACK_WORDS - at);
}
