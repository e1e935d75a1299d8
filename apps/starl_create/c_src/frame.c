#include "frame.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

/* Room that only messages other than data may take. */
enum { RESERVED = 8192 };

bool frames_read(struct frames_in *in)
{
    if (in->have == sizeof in->buf)
        return true;
    ssize_t got = read(in->fd, in->buf + in->have, sizeof in->buf - in->have);
    if (got > 0) {
        in->have += (size_t)got;
        return true;
    }
    return got < 0 && (errno == EAGAIN || errno == EINTR);
}

const uint8_t *frames_next(struct frames_in *in, size_t *length)
{
    if (in->used > 0) {
        in->have -= in->used;
        memmove(in->buf, in->buf + in->used, in->have);
        in->used = 0;
    }
    if (in->have < FRAME_HEAD)
        return NULL;
    *length = (size_t)get_uint(in->buf, FRAME_HEAD);
    if (in->have < FRAME_HEAD + *length)
        return NULL;
    in->used = FRAME_HEAD + *length;
    return in->buf + FRAME_HEAD;
}

static void append(struct frames_out *out, const void *bytes, size_t length)
{
    if (length > 0)
        memcpy(out->buf + out->end, bytes, length);
    out->end += length;
}

void frames_put(struct frames_out *out, char tag, struct part a, struct part b)
{
    size_t length = 1 + a.length + b.length;
    size_t room = sizeof out->buf - (tag == 'd' ? RESERVED : 0);
    if (out->begin > 0 && out->end + FRAME_HEAD + length > room) {
        memmove(out->buf, out->buf + out->begin, out->end - out->begin);
        out->end -= out->begin;
        out->begin = 0;
    }
    if (length > FRAME_MAX || out->end + FRAME_HEAD + length > room) {
        out->left_out++;
        return;
    }
    uint8_t head[FRAME_HEAD + 1] = {(uint8_t)(length >> 8), (uint8_t)length, (uint8_t)tag};
    append(out, head, sizeof head);
    append(out, a.bytes, a.length);
    append(out, b.bytes, b.length);
    frames_flush(out);
}

void frames_flush(struct frames_out *out)
{
    while (out->begin < out->end) {
        ssize_t sent = write(out->fd, out->buf + out->begin, out->end - out->begin);
        if (sent < 0 && errno == EINTR)
            continue;
        if (sent < 0) {
            out->is_broken = errno != EAGAIN;
            break;
        }
        out->begin += (size_t)sent;
    }
    if (out->begin == out->end || out->is_broken)
        out->begin = out->end = 0;
}

void set_nonblocking(int fd)
{
    int flags = fcntl(fd, F_GETFL);
    if (flags >= 0)
        fcntl(fd, F_SETFL, flags | O_NONBLOCK);
}

void put_u64(uint8_t *at, uint64_t value)
{
    for (int i = 7; i >= 0; i--, value >>= 8)
        at[i] = (uint8_t)value;
}

void put_u32(uint8_t *at, uint32_t value)
{
    for (int i = 3; i >= 0; i--, value >>= 8)
        at[i] = (uint8_t)value;
}

uint64_t get_uint(const uint8_t *at, size_t bytes)
{
    uint64_t value = 0;
    for (size_t i = 0; i < bytes; i++)
        value = value << 8 | at[i];
    return value;
}
