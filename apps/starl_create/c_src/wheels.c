#include "port.h"

#include "clock.h"

#include <errno.h>
#include <string.h>

enum {
    /* The begun rest of what was to be written is finished before the wheels are stopped, if it may be
     * that of a command. */
    REST_MAX = 128,
    WRITE_LIMIT_US = 500000,
    LOOK_EACH_US = 20000
};

static struct part text(const char *chars) { return (struct part){chars, strlen(chars)}; }

static void say_opened(struct port *port)
{
    uint8_t at[8];
    put_u64(at, clock_us());
    frames_put(&port->out, 'o', (struct part){at, sizeof at}, text(port->device.path));
}

/* A line that nobody guards, or nobody reads, is not opened. */
static bool accompany(struct port *port)
{
    port->is_stale = false;
    if (!guardian_start(&port->guard, &port->device, port->stop, port->stop_length))
        return false;
    if (reader_start(&port->reader, port->device.fd))
        return true;
    int why = errno;
    guardian_dismiss(&port->guard);
    errno = why;
    return false;
}

/* A device that comes back may be a robot that still drives: the stop bytes go first. */
bool port_open(struct port *port, const char *path, unsigned baud, bool is_quiet)
{
    struct failure why;
    bool comes_back = port->is_lost && strcmp(path, port->device.path) == 0;
    if (port->device.fd >= 0) {
        if (strcmp(path, port->device.path) == 0 && baud == port->device.baud) {
            say_opened(port);
            return true;
        }
        port_close(port);
    }
    port->is_lost = comes_back;
    if (!device_open(&port->device, path, baud, &why)) {
        if (!is_quiet)
            port_fail(port, why.word, why.detail);
        return false;
    }
    if (comes_back)
        device_stop(&port->device, port->stop, port->stop_length, WRITE_LIMIT_US);
    port->may_move = false;
    if (!accompany(port)) {
        if (!is_quiet)
            port_fail(port, "unguarded", strerror(errno));
        device_close(&port->device);
        return false;
    }
    port->is_lost = false;
    say_opened(port);
    return true;
}

static void forget(struct port *port)
{
    port->script.is_running = false;
    port->pending_at = port->pending_end = 0;
    port->toggles = 0;
    port->toggle_us = port->break_us = NEVER;
    guardian_dismiss(&port->guard);
    reader_end(&port->reader);
    device_close(&port->device);
}

void port_close(struct port *port)
{
    port->is_lost = false;
    if (port->device.fd < 0)
        return;
    port_stop(port, NULL);
    forget(port);
}

void port_lost(struct port *port, const char *word)
{
    forget(port);
    port->is_lost = true;
    port->look_us = clock_us() + LOOK_EACH_US;
    port_say(port, 'c', word);
}

void port_write(struct port *port, const uint8_t *bytes, size_t length)
{
    ssize_t sent = length > 0 ? device_write(&port->device, bytes, length) : 0;
    port->may_move = true;
    if (sent < 0 && errno != EAGAIN) {
        port_lost(port, "unplugged");
        return;
    }
    if (sent < 0)
        sent = 0;
    port->pending_at = 0;
    port->pending_end = length - (size_t)sent;
    if (port->pending_end > 0)
        memcpy(port->pending, bytes + sent, port->pending_end);
}

void port_flush(struct port *port)
{
    size_t length = port->pending_end - port->pending_at;
    ssize_t sent = device_write(&port->device, port->pending + port->pending_at, length);
    if (sent < 0 && errno != EAGAIN)
        port_lost(port, "unplugged");
    if (sent <= 0)
        return;
    port->pending_at += (size_t)sent;
    /* Erlang is not read now; a line that moves is sign of life enough. */
    port->heard_us = clock_us();
}

/* A pulse that is not over leaves its line asserted. */
static void release(struct port *port)
{
    if (port->toggle_us != NEVER || port->break_us != NEVER)
        device_release(&port->device);
    port->toggles = 0;
    port->toggle_us = port->break_us = NEVER;
}

/* What waits is void, but for the begun rest of a command: the stop bytes would be taken for it. */
void port_stop(struct port *port, const char *word)
{
    port->script.is_running = false;
    if (port->device.fd < 0)
        return;
    size_t rest = port->pending_end - port->pending_at;
    if (rest > 0 && rest <= REST_MAX)
        device_write_all(&port->device, port->pending + port->pending_at, rest, WRITE_LIMIT_US);
    port->pending_at = port->pending_end = 0;
    release(port);
    device_stop(&port->device, port->stop, port->stop_length, WRITE_LIMIT_US);
    port->may_move = false;
    if (word)
        port_say(port, 'x', word);
}

static void say_marked(struct port *port, char tag)
{
    uint8_t mark[8], at[8];
    put_u64(mark, port->script.mark);
    put_u64(at, clock_us() + device_queue_us(&port->device));
    frames_put(&port->out, tag, (struct part){mark, sizeof mark}, (struct part){at, sizeof at});
}

void port_step(struct port *port)
{
    bool is_first = !port->script.has_begun;
    struct step step = script_step(&port->script, clock_us());
    port_write(port, step.bytes, step.length);
    if (port->is_lost)
        return;
    port->may_move = !step.is_last;
    if (step.is_last)
        say_marked(port, 'n');
    else if (is_first)
        say_marked(port, 's');
}
