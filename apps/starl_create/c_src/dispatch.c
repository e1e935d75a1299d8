#include "port.h"

#include "clock.h"

#include <string.h>

static struct part text(const char *chars) { return (struct part){chars, strlen(chars)}; }

void port_say(struct port *port, char tag, const char *word)
{
    uint8_t at[8];
    put_u64(at, clock_us());
    frames_put(&port->out, tag, (struct part){at, sizeof at}, text(word));
}

void port_fail(struct port *port, const char *word, const char *detail)
{
    frames_put(&port->out, 'e', (struct part){word, strlen(word) + 1}, text(detail));
}

static void open_message(struct port *port, const uint8_t *bytes, size_t length)
{
    char path[PATH_LENGTH];
    size_t path_length = length - 8;
    if (path_length >= sizeof path || memchr(bytes + 8, 0, path_length)) {
        port_fail(port, "no_device", "no such name can be");
        return;
    }
    memcpy(path, bytes + 8, path_length);
    path[path_length] = 0;
    port->heartbeat_us = get_uint(bytes + 4, 4) * 1000u;
    port_open(port, path, (unsigned)get_uint(bytes, 4), false);
}

static void stop_message(struct port *port, const uint8_t *bytes, size_t length)
{
    if (length > STOP_MAX) {
        port_fail(port, "bad_message", "more than 1024 stop bytes");
        return;
    }
    memcpy(port->stop, bytes, length);
    port->stop_length = length;
    guardian_teach(&port->guard, port->stop, length);
}

/* Scripts that were running are void; an empty one is the end at once. Where no stop bytes are known,
 * those of the script are. */
static void script_message(struct port *port, const uint8_t *bytes, size_t length, bool joins)
{
    if (port->is_stale)
        return;
    if (!script_load(&port->script, bytes, length, joins)) {
        port_fail(port, "bad_message", "a malformed drive script");
        return;
    }
    if (port->stop_length == 0)
        stop_message(port, port->script.end, port->script.end_length);
    if (script_due_us(&port->script, clock_us()) <= clock_us())
        port_step(port);
}

/* A pulse asserts the line and releases it; it rests as long between two. */
static void pulse_message(struct port *port, const uint8_t *bytes)
{
    port->line = bytes[0] == 0 ? LINE_DTR : LINE_RTS;
    port->low_us = get_uint(bytes + 1, 2) * 1000u;
    port->toggles = 2u * bytes[3];
    port->toggle_us = clock_us();
}

void port_pulse(struct port *port, uint64_t now_us)
{
    if (now_us >= port->toggle_us) {
        bool is_asserted = port->toggles % 2 == 0 && port->toggles > 0;
        device_line(&port->device, port->line, is_asserted);
        if (port->toggles > 0)
            port->toggles--;
        port->toggle_us = port->toggles > 0 ? now_us + port->low_us : NEVER;
    }
    if (now_us >= port->break_us) {
        device_break(&port->device, false);
        port->break_us = NEVER;
    }
}

static void break_message(struct port *port, const uint8_t *bytes)
{
    if (device_break(&port->device, true))
        port->break_us = clock_us() + get_uint(bytes, 2) * 1000u;
    else
        port_fail(port, "io", "the device knows no break");
}

static void speed_message(struct port *port, const uint8_t *bytes)
{
    struct failure why;
    if (device_speed(&port->device, (unsigned)get_uint(bytes, 4), &why))
        guardian_speed(&port->guard, port->device.baud);
    else
        port_fail(port, why.word, why.detail);
}

/* Messages that need an open line. */
static void line_message(struct port *port, char tag, const uint8_t *bytes, size_t length)
{
    if (port->device.fd < 0)
        port_fail(port, "closed", "no device is open");
    else if (tag == 'W')
        port_write(port, bytes, length);
    else if (tag == 'D' || tag == 'J')
        script_message(port, bytes, length, tag == 'J');
    else if (tag == 'L' && length == 4)
        pulse_message(port, bytes);
    else if (tag == 'B' && length == 2)
        break_message(port, bytes);
    else if (tag == 'S' && length == 4)
        speed_message(port, bytes);
    else
        port_fail(port, "bad_message", "of the wrong length");
}

void port_message(struct port *port, const uint8_t *bytes, size_t length)
{
    port->heard_us = clock_us();
    port->is_silent = false;
    char tag = length > 0 ? (char)bytes[0] : 0;
    if (tag == 'H' && length == 1)
        return;
    if (tag == 'Z')
        stop_message(port, bytes + 1, length - 1);
    else if (tag == 'C' && length == 1)
        port_close(port);
    else if (tag == 'O' && length > 9)
        open_message(port, bytes + 1, length - 1);
    else if (tag != 0 && strchr("WDJLBS", tag))
        line_message(port, tag, bytes + 1, length - 1);
    else
        port_fail(port, "bad_message", "of no known kind");
}
