/* Preloaded into linux.uml, not into programs that run inside it: supports processors with a large XSAVE area.
 *
 * User Mode Linux 6.1 supports an XSAVE area that ends before that of Intel AMX (11008 bytes). The host's kernel rejects a
 * PTRACE_SETREGSET of the shorter one (EFAULT), and the guest dies with "ptrace set fp regs failed, errno = 14". Here the
 * buffer is padded to the host's size; the components beyond its end are marked as in their initial state.
 *
 *     cc -O2 -shared -fPIC -o uml-xstate.so uml-xstate.c
 */
#define _GNU_SOURCE
#include <cpuid.h>
#include <elf.h>
#include <stdarg.h>
#include <stdint.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

enum { XSAVE_LEAF = 0xd, XSTATE_BV_OFFSET = 512, FIRST_EXTENDED = 2, COMPONENTS = 63, LARGEST = 65536 };

static unsigned host_size;
static uint64_t beyond; /* the components that do not fit into the guest's area */

static void look_at_the_host(size_t guest_size)
{
    unsigned eax, ebx, ecx, edx;
    __cpuid_count(XSAVE_LEAF, 0, eax, ebx, ecx, edx);
    host_size = ebx;
    for (unsigned i = FIRST_EXTENDED; i < COMPONENTS; i++) {
        unsigned size, offset, flags, unused;
        __cpuid_count(XSAVE_LEAF, i, size, offset, flags, unused);
        const int is_user_state = (flags & 1u) == 0u;
        if (size != 0u && is_user_state && (size_t)offset + size > guest_size) {
            beyond |= UINT64_C(1) << i;
        }
    }
}

static long set_xstate(long pid, void *address, const struct iovec *guest)
{
    static char area[LARGEST] __attribute__((aligned(64))); /* static: linux.uml has one thread */
    if (host_size == 0u) {
        look_at_the_host(guest->iov_len);
    }
    if (guest->iov_len >= host_size || host_size > sizeof area) {
        return syscall(SYS_ptrace, (long)PTRACE_SETREGSET, pid, address, guest);
    }
    uint64_t present;
    memcpy(area, guest->iov_base, guest->iov_len);
    memcpy(&present, area + XSTATE_BV_OFFSET, sizeof present);
    present &= ~beyond;
    memcpy(area + XSTATE_BV_OFFSET, &present, sizeof present);
    struct iovec padded = {area, host_size};
    return syscall(SYS_ptrace, (long)PTRACE_SETREGSET, pid, address, &padded);
}

long ptrace(enum __ptrace_request request, ...)
{
    va_list arguments;
    va_start(arguments, request);
    const long pid = va_arg(arguments, int);
    void *const address = va_arg(arguments, void *);
    void *const data = va_arg(arguments, void *);
    va_end(arguments);
    if (request == PTRACE_SETREGSET && (long)address == NT_X86_XSTATE) {
        return set_xstate(pid, address, data);
    }
    if (request >= PTRACE_PEEKTEXT && request <= PTRACE_PEEKUSER) {
        /* The system call stores what the library function returns. */
        long value = 0;
        const long result = syscall(SYS_ptrace, (long)request, pid, address, &value);
        return result < 0 ? result : value;
    }
    return syscall(SYS_ptrace, (long)request, pid, address, data);
}
