/*
 * Functions that a compiler calls to copy or clear memory. The linker drops the unused ones.
 *
 * The pointers are volatile because a compiler could otherwise replace the loop in memcpy() by a call of memcpy(). Remove this file from
 * a project with a C library.
 */
#include <stddef.h>
#include <stdint.h>

void *memcpy(void *to, const void *from, size_t size);
void *memmove(void *to, const void *from, size_t size);
void *memset(void *to, int value, size_t size);
void __aeabi_memcpy(void *to, const void *from, size_t size);
void __aeabi_memcpy4(void *to, const void *from, size_t size);
void __aeabi_memcpy8(void *to, const void *from, size_t size);
void __aeabi_memclr(void *to, size_t size);
void __aeabi_memclr4(void *to, size_t size);
void __aeabi_memclr8(void *to, size_t size);

void *memcpy(void *to, const void *from, size_t size)
{
    return memmove(to, from, size);
}

void *memmove(void *to, const void *from, size_t size)
{
    volatile uint8_t *const target = to;
    const volatile uint8_t *const source = from;
    size_t at;

    if ((uintptr_t)to < (uintptr_t)from) {
        for (at = 0u; at < size; at++) {
            target[at] = source[at];
        }
    } else {
        for (at = size; at > 0u; at--) {
            target[at - 1u] = source[at - 1u];
        }
    }
    return to;
}

void *memset(void *to, int value, size_t size)
{
    volatile uint8_t *const target = to;
    size_t at;

    for (at = 0u; at < size; at++) {
        target[at] = (uint8_t)value;
    }
    return to;
}

/* Names of the ARM run-time ABI (IHI 0043, 4.3.4), which clang uses. */

void __aeabi_memcpy(void *to, const void *from, size_t size)
{
    (void)memmove(to, from, size);
}

void __aeabi_memcpy4(void *to, const void *from, size_t size)
{
    (void)memmove(to, from, size);
}

void __aeabi_memcpy8(void *to, const void *from, size_t size)
{
    (void)memmove(to, from, size);
}

void __aeabi_memclr(void *to, size_t size)
{
    (void)memset(to, 0, size);
}

void __aeabi_memclr4(void *to, size_t size)
{
    (void)memset(to, 0, size);
}

void __aeabi_memclr8(void *to, size_t size)
{
    (void)memset(to, 0, size);
}
