/* One poll loop: Erlang, the line, the guardian, the clock. */
#include "port.h"

#include "clock.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum { LOOK_EACH_US = 20000, FLUSH_EACH_US = 1000, AT = 8 };
enum { IN, OUT, LINE, GUARD, POLLED };

static volatile sig_atomic_t is_ended;

static void end(int signal_number)
{
    (void)signal_number;
    is_ended = 1;
}

static bool is_pending(const struct port *port) { return port->pending_end > port->pending_at; }

static bool is_watched(const struct port *port)
{
    return port->heartbeat_us > 0 && port->device.fd >= 0 && !port->is_silent;
}

static uint64_t next_us(const struct port *port, uint64_t now_us)
{
    uint64_t next = earlier(port->toggle_us, port->break_us);
    /* A line that is polled is waited for (reader.h). */
    if (is_pending(port))
        next = earlier(next, now_us + FLUSH_EACH_US);
    else
        next = earlier(next, script_due_us(&port->script, now_us));
    if (is_watched(port))
        next = earlier(next, port->heard_us + port->heartbeat_us);
    if (port->is_lost)
        next = earlier(next, port->look_us);
    return next;
}

static void wait_for(struct port *port, struct pollfd *fds)
{
    uint64_t now = clock_us(), next = next_us(port, now);
    uint64_t span = next > now ? next - now : 0;
    struct timespec limit = {(time_t)(span / 1000000u), (long)(span % 1000000u) * 1000};
    fds[IN] = (struct pollfd){port->in.fd, is_pending(port) ? 0 : POLLIN, 0};
    fds[OUT] = (struct pollfd){port->out.fd, frames_waiting(&port->out) ? POLLOUT : 0, 0};
    fds[LINE] = (struct pollfd){port->reader.in.fd, POLLIN, 0};
    fds[GUARD] = (struct pollfd){port->guard.pipe, 0, 0};
    if (ppoll(fds, POLLED, next == NEVER ? NULL : &limit, NULL) < 0)
        for (int i = 0; i < POLLED; i++)
            fds[i].revents = 0;
}

/* One that was killed is replaced; the wheels stand until Erlang moves them again. */
static void guard_died(struct port *port)
{
    guardian_bury(&port->guard);
    port_stop(port, "guardian");
    guardian_start(&port->guard, port->device.fd, port->stop, port->stop_length);
}

/* What the reader passes on; it ends with the line. */
static void line_ready(struct port *port)
{
    const uint8_t *message;
    size_t length;
    bool is_there = frames_read(&port->reader.in);
    while ((message = frames_next(&port->reader.in, &length)))
        if (length > AT)
            frames_put(&port->out, 'd', (struct part){message, AT}, (struct part){message + AT, length - AT});
    if (!is_there)
        port_lost(port, "unplugged");
}

static void look_again(struct port *port, uint64_t now_us)
{
    if (!port->is_lost || now_us < port->look_us)
        return;
    port->look_us = now_us + LOOK_EACH_US;
    port_open(port, port->device.path, port->device.baud, true);
}

static void time_passed(struct port *port)
{
    uint64_t now = clock_us();
    if (is_watched(port) && now >= port->heard_us + port->heartbeat_us) {
        port->is_silent = true;
        port_stop(port, "heartbeat");
    }
    while (!is_pending(port) && now >= script_due_us(&port->script, now))
        port_step(port);
    port_pulse(port, now);
    look_again(port, now);
}

static void messages(struct port *port)
{
    const uint8_t *bytes;
    size_t length;
    while (!is_pending(port) && (bytes = frames_next(&port->in, &length)))
        port_message(port, bytes, length);
}

/* False: Erlang has closed. */
static bool erlang_ready(struct port *port, short events)
{
    if (events & POLLIN && !frames_read(&port->in))
        return false;
    messages(port);
    return !(events & (POLLERR | POLLNVAL)) && (events & POLLIN || !(events & POLLHUP));
}

static void prepare(struct port *port)
{
    struct sigaction action = {.sa_handler = end};
    sigaction(SIGTERM, &action, NULL);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGHUP, &action, NULL);
    signal(SIGPIPE, SIG_IGN);
    port->in.fd = STDIN_FILENO;
    port->out.fd = STDOUT_FILENO;
    set_nonblocking(STDIN_FILENO);
    set_nonblocking(STDOUT_FILENO);
    port->device.fd = port->guard.pipe = port->reader.in.fd = -1;
    port->toggle_us = port->break_us = NEVER;
}

int port_run(void)
{
    static struct port port;
    struct pollfd fds[POLLED];
    prepare(&port);
    while (!is_ended) {
        wait_for(&port, fds);
        if (!erlang_ready(&port, fds[IN].revents) || fds[OUT].revents & POLLERR)
            break;
        if (fds[OUT].revents & POLLOUT)
            frames_flush(&port.out);
        if (port.device.fd >= 0 && fds[GUARD].revents & POLLERR && fds[GUARD].fd == port.guard.pipe)
            guard_died(&port);
        if (port.device.fd >= 0 && fds[LINE].fd == port.reader.in.fd && fds[LINE].revents)
            line_ready(&port);
        if (is_pending(&port))
            port_flush(&port);
        messages(&port);
        time_passed(&port);
    }
    port_close(&port);
    return 0;
}
