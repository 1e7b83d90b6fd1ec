/* Answers each frame 0x101 with a frame 0x201 of the same payload. Usage: replier INTERFACE; prints "ready" once it listens. */
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <stdio.h>
#include <sys/socket.h>
#include <unistd.h>

static int fail(const char *what)
{
    perror(what);
    return 1;
}

int main(int argc, char **argv)
{
    const struct can_filter filter = {.can_id = 0x101, .can_mask = CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG};
    struct sockaddr_can address = {.can_family = AF_CAN};
    const int can = socket(AF_CAN, SOCK_RAW, CAN_RAW);
    if (can < 0 || setsockopt(can, SOL_CAN_RAW, CAN_RAW_FILTER, &filter, sizeof filter) != 0) {
        return fail("socket");
    }
    address.can_ifindex = argc > 1 ? (int)if_nametoindex(argv[1]) : 0;
    if (address.can_ifindex == 0 || bind(can, (const struct sockaddr *)&address, sizeof address) != 0) {
        return fail("interface");
    }
    puts("ready");
    fflush(stdout);
    for (;;) {
        struct can_frame frame;
        if (read(can, &frame, sizeof frame) != sizeof frame) {
            return fail("read");
        }
        frame.can_id = 0x201;
        if (write(can, &frame, sizeof frame) != sizeof frame) {
            return fail("write");
        }
    }
}
