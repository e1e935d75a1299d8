/* starl_create_port: a serial line for Erlang that stops the wheels (without arguments), or the pty
 * of an emulator (`pty [LINK]'). Erlang starts it; messages come on standard input. */
#include "port.h"

#include <sched.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

/* A command must not last longer because the computer is busy: first by real-time scheduling, else by
 * the highest priority, as far as the user may. The program sleeps nearly all the time. */
static const char *in_time(void)
{
    struct sched_param lowest = {.sched_priority = 1};

    if (sched_setscheduler(0, SCHED_FIFO, &lowest) == 0)
        return "realtime";
    return setpriority(PRIO_PROCESS, 0, -20) == 0 ? "raised" : "ordinary";
}

int main(int argc, char **argv)
{
    const char *priority = in_time();
    if (argc >= 2 && argc <= 3 && strcmp(argv[1], "pty") == 0)
        return pty_run(argc == 3 ? argv[2] : NULL);
    if (argc == 1 && !isatty(STDIN_FILENO))
        return port_run(priority);
    fprintf(stderr, "%s: ./starl starts this program; see doc/create.md\n", argv[0]);
    return 2;
}
