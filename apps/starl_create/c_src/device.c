#include "device.h"

#include "clock.h"
#include "guardian.h"
#include "note.h"
#include "speed.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

/* A guardian that has just stopped the wheels may hold the lock for a moment. */
enum { LOCK_TRIES = 30, LOCK_PAUSE_US = 10000 };

static bool fail(struct failure *why, const char *word, const char *detail)
{
    why->word = word;
    snprintf(why->detail, sizeof why->detail, "%s", detail);
    return false;
}

static bool fail_open(const char *path, struct failure *why)
{
    switch (errno) {
    case ENOENT: case ENXIO: case ENODEV: case EIO:
        return fail(why, "no_device", strerror(errno));
    case EACCES: case EPERM:
        return fail(why, "permission", strerror(errno));
    case EBUSY: case EWOULDBLOCK:
        why->word = "busy";
        device_holder(path, why->detail, sizeof why->detail);
        return false;
    case ENOTTY: case EISDIR:
        return fail(why, "not_serial", strerror(errno));
    default:
        return fail(why, "io", strerror(errno));
    }
}

/* A line that was opened for one program alone is shut to users without rights before its lock is met. */
static int open_line(const char *path)
{
    for (int i = 0;; i++) {
        int fd = open(path, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
        if (fd >= 0 || errno != EBUSY || i >= LOCK_TRIES)
            return fd;
        clock_sleep_us(LOCK_PAUSE_US);
    }
}

static bool lock(int fd)
{
    for (int i = 0; flock(fd, LOCK_EX | LOCK_NB) != 0; i++) {
        if (errno != EWOULDBLOCK || i >= LOCK_TRIES)
            return false;
        clock_sleep_us(LOCK_PAUSE_US);
    }
    return true;
}

/* No echo, no translation, no signals, no flow control; a close must pulse no line. */
static bool make_raw(int fd)
{
    struct termios line;
    if (tcgetattr(fd, &line) != 0)
        return false;
    cfmakeraw(&line);
    line.c_cflag &= ~(tcflag_t)(CSTOPB | PARENB | CSIZE | HUPCL | CRTSCTS);
    line.c_cflag |= CS8 | CLOCAL | CREAD;
    line.c_cc[VMIN] = 1;
    line.c_cc[VTIME] = 0;
    return tcsetattr(fd, TCSANOW, &line) == 0;
}

bool device_open(struct device *dev, const char *path, unsigned baud, struct failure *why)
{
    int fd = open_line(path);
    if (fd < 0)
        return fail_open(path, why);
    if (!isatty(fd)) {
        errno = ENOTTY;
    } else if (lock(fd) && ioctl(fd, TIOCEXCL) == 0 && make_raw(fd)) {
        if (path != dev->path)
            snprintf(dev->path, sizeof dev->path, "%s", path);
        dev->fd = fd;
        if (device_speed(dev, baud, why)) {
            tcflush(fd, TCIFLUSH);
            dev->notes = notes_open(fd);
            device_line(dev, LINE_DTR, false);
            device_line(dev, LINE_RTS, false);
            return true;
        }
        device_close(dev);
        return false;
    }
    fail_open(path, why);
    close(fd);
    return false;
}

void device_close(struct device *dev)
{
    if (dev->fd >= 0) {
        ioctl(dev->fd, TIOCNXCL);
        close(dev->fd);
    }
    notes_close(dev->notes);
    dev->notes = NULL;
    dev->fd = -1;
}

ssize_t device_write(struct device *dev, const uint8_t *bytes, size_t length)
{
    ssize_t sent;
    notes_put(dev->notes, length);
    do
        sent = write(dev->fd, bytes, length);
    while (sent < 0 && errno == EINTR);
    int why = errno;
    notes_less(dev->notes, length - (sent < 0 ? 0 : (size_t)sent));
    errno = why;
    return sent;
}

bool device_write_all(struct device *dev, const uint8_t *bytes, size_t length, uint64_t limit_us)
{
    notes_put(dev->notes, length);
    return write_all(dev->fd, bytes, length, limit_us);
}

bool device_stop(struct device *dev, const uint8_t *stop, size_t length, uint64_t limit_us)
{
    static const uint8_t zeros[COMMAND_MAX];
    if (length == 0)
        return true;
    return device_write_all(dev, zeros, FIXED_MAX, limit_us)
        && device_write_all(dev, stop, length, limit_us)
        && device_write_all(dev, zeros, COMMAND_MAX, limit_us)
        && device_write_all(dev, stop, length, limit_us);
}

/* Ten bits a byte. */
uint64_t device_queue_us(const struct device *dev)
{
    int queued = 0;
    if (dev->baud == 0 || ioctl(dev->fd, TIOCOUTQ, &queued) != 0 || queued < 0)
        return 0;
    return (uint64_t)queued * 10u * 1000000u / dev->baud;
}

bool device_speed(struct device *dev, unsigned baud, struct failure *why)
{
    if (baud == 0 || !speed_set(dev->fd, baud) || speed_get(dev->fd) == 0)
        return fail(why, "speed", "the driver of the device does not take it");
    dev->baud = baud;
    return true;
}

bool device_line(struct device *dev, enum control_line line, bool is_asserted)
{
    int bit = line == LINE_DTR ? TIOCM_DTR : TIOCM_RTS;
    if (ioctl(dev->fd, is_asserted ? TIOCMBIS : TIOCMBIC, &bit) == 0)
        return true;
    return speed_set(dev->fd, is_asserted ? 0 : dev->baud);
}

bool device_break(struct device *dev, bool is_on)
{
    return ioctl(dev->fd, is_on ? TIOCSBRK : TIOCCBRK, 0) == 0;
}

void device_release(struct device *dev)
{
    int bits = TIOCM_DTR | TIOCM_RTS;
    device_break(dev, false);
    if (ioctl(dev->fd, TIOCMBIC, &bits) != 0 && speed_get(dev->fd) == 0)
        speed_set(dev->fd, dev->baud);
}
