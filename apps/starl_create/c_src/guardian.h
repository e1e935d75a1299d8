/* The guardian: a process that holds the line as well, and stops the wheels when the port program
 * ends without having done so. */
#ifndef STARL_GUARDIAN_H
#define STARL_GUARDIAN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

enum { STOP_MAX = 1024 };

struct guardian {
    int pipe; /* -1: none */
    pid_t pid;
};

bool guardian_start(struct guardian *guard, int device, const uint8_t *stop, size_t length);
/* The bytes with which it stops the wheels. */
void guardian_teach(struct guardian *guard, const uint8_t *stop, size_t length);
/* Sends it away; it writes nothing. */
void guardian_dismiss(struct guardian *guard);
/* It has died by itself. */
void guardian_bury(struct guardian *guard);

/* A process by this name, from its first moment. */
pid_t fork_named(const char *name);

/* Writes all bytes, for at most this time. */
bool write_all(int fd, const uint8_t *bytes, size_t length, uint64_t limit_us);

#endif
