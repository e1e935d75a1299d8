#include "speed.h"

#ifdef __linux__

/* The kernel's own termios2, in which a speed is a number (BOTHER). Its header cannot stand beside
 * <termios.h>, hence this file. */
#include <asm/termbits.h>
#include <sys/ioctl.h>

bool speed_set(int fd, unsigned baud)
{
    struct termios2 line;
    if (ioctl(fd, TCGETS2, &line) != 0)
        return false;
    line.c_cflag &= ~(unsigned)(CBAUD | CBAUD << IBSHIFT);
    if (baud > 0)
        line.c_cflag |= BOTHER;
    line.c_ospeed = line.c_ispeed = baud;
    return ioctl(fd, TCSETS2, &line) == 0;
}

unsigned speed_get(int fd)
{
    struct termios2 line;
    if (ioctl(fd, TCGETS2, &line) != 0 || (line.c_cflag & CBAUD) == B0)
        return 0;
    return line.c_ospeed;
}

#else

#include <stddef.h>
#include <termios.h>

static const struct {
    unsigned baud;
    speed_t name;
} speeds[] = {
    {0, B0}, {300, B300}, {600, B600}, {1200, B1200}, {2400, B2400}, {4800, B4800}, {9600, B9600},
    {19200, B19200}, {38400, B38400}, {57600, B57600}, {115200, B115200}, {230400, B230400},
};

bool speed_set(int fd, unsigned baud)
{
    struct termios line;
    if (tcgetattr(fd, &line) != 0)
        return false;
    for (size_t i = 0; i < sizeof speeds / sizeof *speeds; i++)
        if (speeds[i].baud == baud)
            return cfsetispeed(&line, speeds[i].name) == 0 && cfsetospeed(&line, speeds[i].name) == 0
                && tcsetattr(fd, TCSANOW, &line) == 0;
    return false;
}

unsigned speed_get(int fd)
{
    struct termios line;
    if (tcgetattr(fd, &line) != 0)
        return 0;
    for (size_t i = 0; i < sizeof speeds / sizeof *speeds; i++)
        if (speeds[i].name == cfgetospeed(&line))
            return speeds[i].baud;
    return 0;
}

#endif
