/* Messages with their length in front (two bytes, big endian), as of Erlang's {packet, 2}. */
#ifndef STARL_FRAME_H
#define STARL_FRAME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { FRAME_MAX = 65535, FRAME_HEAD = 2 };

/* What comes in. A message is valid until the next call. */
struct frames_in {
    int fd;
    size_t have, used;
    uint8_t buf[FRAME_HEAD + FRAME_MAX];
};

/* What goes out. A reader that is slow or asleep must never hold up the wheels: what does not fit is
 * left out and counted. */
struct frames_out {
    int fd;
    bool is_broken;
    size_t begin, end;
    uint64_t left_out;
    uint8_t buf[4 * FRAME_MAX];
};

/* A part of a message. */
struct part {
    const void *bytes;
    size_t length;
};

/* Reads what there is, once. False: the other side has closed. */
bool frames_read(struct frames_in *in);
/* The next whole message; NULL if there is none. */
const uint8_t *frames_next(struct frames_in *in, size_t *length);

/* Sends `tag' and two parts as a message. Plain data leaves room for what must be told. */
void frames_put(struct frames_out *out, char tag, struct part a, struct part b);
void frames_flush(struct frames_out *out);
static inline bool frames_waiting(const struct frames_out *out) { return out->end > out->begin; }

void set_nonblocking(int fd);
void put_u64(uint8_t *at, uint64_t value);
void put_u32(uint8_t *at, uint32_t value);
uint64_t get_uint(const uint8_t *at, size_t bytes);

#endif
