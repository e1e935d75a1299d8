/* The guardian: a process that holds the line as well, and stops the wheels when the port program
 * ends without having done so, or is halted. The two watch each other over a socket:
 *
 *   to the guardian   H                  a sign of life, every BEAT_US
 *                     Z bytes            the stop bytes
 *                     S baud:32          the speed of the line
 *                     (empty)            dismissed: it ends, and writes nothing
 *   from it           h                  to each sign of life
 *                     w                  it heard none for HALTED_US, and stops the wheels now
 *                     x                  it has stopped them
 */
#ifndef STARL_GUARDIAN_H
#define STARL_GUARDIAN_H

#include "device.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

enum {
    STOP_MAX = 1024,
    BEAT_US = 50000,
    HALTED_US = 250000,
    /* A guardian of ordinary priority may wait for its turn on a busy computer. */
    GUARD_HALTED_US = 1000000
};

struct guardian {
    int socket; /* -1: none */
    pid_t pid;
    uint64_t beat_us;  /* when the next sign of life is due */
    uint64_t heard_us; /* its last one, or when it was not owed any */
};

/* What it has said. */
enum guardian_word { GUARDIAN_WELL, GUARDIAN_STOPS, GUARDIAN_HAS_STOPPED };

bool guardian_start(struct guardian *guard, const struct device *dev, const uint8_t *stop,
                    size_t length);
/* The bytes with which it stops the wheels. */
void guardian_teach(struct guardian *guard, const uint8_t *stop, size_t length);
/* The line has another speed now. */
void guardian_speed(struct guardian *guard, unsigned baud);
/* Gives a sign of life if one is due. */
void guardian_beat(struct guardian *guard, uint64_t now_us);
enum guardian_word guardian_heard(struct guardian *guard, uint64_t now_us);
/* Has it owed a sign of life for too long? */
bool guardian_is_halted(const struct guardian *guard, uint64_t now_us);
/* Sends it away; it writes nothing. */
void guardian_dismiss(struct guardian *guard);
/* It has died by itself, or is to. */
void guardian_bury(struct guardian *guard);

/* A process by this name, from its first moment. */
pid_t fork_named(const char *name);

/* Standard input, output and errors lead nowhere from now on. */
void let_go_of_streams(void);

/* Writes all bytes, for at most this time. */
bool write_all(int fd, const uint8_t *bytes, size_t length, uint64_t limit_us);

#endif
