/* starl_create_port: a serial line for Erlang that stops the wheels (without arguments), or the pty
 * of an emulator (`pty [LINK]'). Erlang starts it; messages come on standard input. */
#include "port.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

int main(int argc, char **argv)
{
    if (argc >= 2 && argc <= 3 && strcmp(argv[1], "pty") == 0)
        return pty_run(argc == 3 ? argv[2] : NULL);
    if (argc == 1 && !isatty(STDIN_FILENO))
        return port_run();
    fprintf(stderr, "%s: ./starl starts this program; see doc/create.md\n", argv[0]);
    return 2;
}
