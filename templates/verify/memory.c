/* Functions that a compiler may call to copy or clear a struct. Every toolchain provides them; unused ones are not linked. */
#include <stddef.h>
void *memcpy(void *to, const void *from, size_t size);
void *memset(void *to, int value, size_t size);
void __aeabi_memcpy(void *to, const void *from, size_t size);
void __aeabi_memclr(void *to, size_t size);
void *memcpy(void *to, const void *from, size_t size)
{
    __aeabi_memcpy(to, from, size);
    return to;
}
void *memset(void *to, int value, size_t size)
{
    for (size_t k = 0; k < size; k++) {
        ((unsigned char *)to)[k] = (unsigned char)value;
    }
    return to;
}
void __aeabi_memcpy(void *to, const void *from, size_t size)
{
    for (size_t k = 0; k < size; k++) {
        ((unsigned char *)to)[k] = ((const unsigned char *)from)[k];
    }
}
void __aeabi_memclr(void *to, size_t size)
{
    (void)memset(to, 0, size);
}
void __aeabi_memcpy4(void *to, const void *from, size_t size) __attribute__((alias("__aeabi_memcpy")));
void __aeabi_memcpy8(void *to, const void *from, size_t size) __attribute__((alias("__aeabi_memcpy")));
void __aeabi_memclr4(void *to, size_t size) __attribute__((alias("__aeabi_memclr")));
void __aeabi_memclr8(void *to, size_t size) __attribute__((alias("__aeabi_memclr")));
