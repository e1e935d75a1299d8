#include "script.h"

#include "clock.h"

#include <string.h>

/* A step that would begin later than this is not begun: the one before it has lasted too long. */
enum { HEAD = 10, STEP_HEAD = 6, LATEST_US = 25000 };

static bool is_sound(const uint8_t *bytes, size_t length)
{
    if (length < HEAD)
        return false;
    size_t at = HEAD + (size_t)get_uint(bytes + 8, 2);
    while (at + STEP_HEAD <= length)
        at += STEP_HEAD + (size_t)get_uint(bytes + at + 4, 2);
    return at == length;
}

bool script_load(struct script *script, const uint8_t *bytes, size_t length, bool joins)
{
    bool waits = joins && script->is_running && script->has_begun;
    if (length > sizeof script->buf || !is_sound(bytes, length))
        return false;
    memcpy(script->buf, bytes, length);
    script->mark = get_uint(bytes, 8);
    script->end = script->buf + HEAD;
    script->end_length = (size_t)get_uint(bytes + 8, 2);
    script->at = HEAD + script->end_length;
    script->length = length;
    script->start_us += waits ? script->offset_us : 0;
    script->offset_us = 0;
    script->has_begun = waits;
    script->is_running = true;
    return true;
}

uint64_t script_due_us(const struct script *script, uint64_t now_us)
{
    if (!script->is_running)
        return NEVER;
    return script->has_begun ? script->start_us + script->offset_us : now_us;
}

struct step script_step(struct script *script, uint64_t now_us)
{
    if (!script->has_begun) {
        script->has_begun = true;
        script->start_us = now_us;
    }
    bool is_late = now_us > script->start_us + script->offset_us + LATEST_US;
    if (script->at >= script->length || is_late) {
        script->is_running = false;
        return (struct step){script->end, script->end_length, true};
    }
    const uint8_t *step = script->buf + script->at;
    size_t length = (size_t)get_uint(step + 4, 2);
    script->offset_us += get_uint(step, 4);
    script->at += STEP_HEAD + length;
    return (struct step){step + STEP_HEAD, length, false};
}
