/* A drive script: bytes and the times at which they leave, then the bytes that end it. */
#ifndef STARL_SCRIPT_H
#define STARL_SCRIPT_H

#include "frame.h"

struct script {
    bool is_running, has_begun;
    uint64_t mark;
    uint64_t start_us; /* when its first bytes left */
    uint64_t offset_us; /* of what comes next, from the start */
    size_t at, length;
    const uint8_t *end; /* the bytes that end it, in `buf' */
    size_t end_length;
    uint8_t buf[FRAME_MAX];
};

struct step {
    const uint8_t *bytes;
    size_t length;
    bool is_last;
};

/* Takes `Mark:64 EndLength:16 End (WaitUs:32 Length:16 Bytes)*'. False: malformed, nothing changed.
 * `joins': it begins when the next step of the one that runs is due, not now. */
bool script_load(struct script *script, const uint8_t *bytes, size_t length, bool joins);
/* When the next step is due. */
uint64_t script_due_us(const struct script *script, uint64_t now_us);
/* The next step, which goes out now. */
struct step script_step(struct script *script, uint64_t now_us);

#endif
