/* A serial line: open, locked, raw, 8N1. */
#ifndef STARL_DEVICE_H
#define STARL_DEVICE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

struct notes;

enum {
    PATH_LENGTH = 1024,
    /* Bytes after which a command has its fixed part; that of a song, the longest to a robot that drives,
     * is whole after so many more. */
    FIXED_MAX = 4,
    COMMAND_MAX = 40
};

/* Why something did not work: a word that Erlang knows, and a detail for a person. */
struct failure {
    const char *word;
    char detail[160];
};

struct device {
    int fd; /* -1: closed */
    unsigned baud;
    struct notes *notes; /* of what is written to an emulator */
    char path[PATH_LENGTH];
};

enum control_line { LINE_DTR = 0, LINE_RTS = 1 };

bool device_open(struct device *dev, const char *path, unsigned baud, struct failure *why);
void device_close(struct device *dev);
/* What write(2) gives; -1 with EAGAIN as well. */
ssize_t device_write(struct device *dev, const uint8_t *bytes, size_t length);
/* Writes all bytes, for at most this time. */
bool device_write_all(struct device *dev, const uint8_t *bytes, size_t length, uint64_t limit_us);
/* Writes what stops the wheels, twice. A command that was begun takes what follows for its own rest, so
 * zeros go before: they are no command, and where a number of bytes is to be said, it is none. */
bool device_stop(struct device *dev, const uint8_t *stop, size_t length, uint64_t limit_us);
/* When the bytes that were written will have left the line, microseconds from now. */
uint64_t device_queue_us(const struct device *dev);
bool device_speed(struct device *dev, unsigned baud, struct failure *why);
/* Asserts or releases a line. A line without it (a pty) is hung up instead, by speed 0, which the
 * other side of a pty sees. */
bool device_line(struct device *dev, enum control_line line, bool is_asserted);
bool device_break(struct device *dev, bool is_on);
/* Releases all lines, and ends a break. */
void device_release(struct device *dev);
/* The process that holds a device, if that can be found out. */
void device_holder(const char *path, char *text, size_t size);

#endif
