/* One poll loop: Erlang, the line, the guardian, the clock. */
#include "port.h"

#include "clock.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum { LOOK_EACH_US = 20000, LOOK_LATER_US = 100000, FLUSH_EACH_US = 1000, STOP_LIMIT_US = 500000, AT = 8 };

static const uint64_t STAYS_US = UINT64_C(600) * 1000000;
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
    if (port->guard.socket >= 0)
        next = earlier(next, port->guard.beat_us);
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
    fds[GUARD] = (struct pollfd){port->guard.socket, POLLIN, 0};
    if (ppoll(fds, POLLED, next == NEVER ? NULL : &limit, NULL) < 0)
        for (int i = 0; i < POLLED; i++)
            fds[i].revents = 0;
}

static void messages(struct port *port)
{
    const uint8_t *bytes;
    size_t length;
    while (!is_pending(port) && (bytes = frames_next(&port->in, &length)))
        port_message(port, bytes, length);
}

/* One that was killed, or is halted, is replaced; the wheels stand until Erlang moves them again. A
 * line that nobody guards is given up. */
static void guard_died(struct port *port)
{
    guardian_bury(&port->guard);
    port->is_stale = false;
    port_stop(port, "guardian");
    if (!guardian_start(&port->guard, &port->device, port->stop, port->stop_length))
        port_lost(port, "unguarded");
}

/* It stops the wheels, since this program was halted. Until it has, nothing is driven: what came before
 * its stop bytes would be undone by them, what comes among them would be taken for them. */
static void is_being_stopped(struct port *port)
{
    port->script.is_running = false;
    port->is_stale = true;
}

/* It has stopped the wheels, since this program was halted. What Erlang has sent meanwhile is too old
 * to be driven. */
static void was_halted(struct port *port)
{
    port_stop(port, NULL);
    port->is_stale = true;
    size_t have;
    do {
        messages(port);
        have = port->in.have;
    } while (frames_read(&port->in) && port->in.have > have);
    port->is_stale = false;
    port_say(port, 'x', "halted");
}

/* Asked whatever the last poll has said: this program may have been halted since then. */
static void ask_guard(struct port *port, short events)
{
    if (events & (POLLERR | POLLHUP)) {
        guard_died(port);
        return;
    }
    switch (guardian_heard(&port->guard, clock_us())) {
    case GUARDIAN_HAS_STOPPED: was_halted(port); break;
    case GUARDIAN_STOPS: is_being_stopped(port); break;
    case GUARDIAN_WELL: break;
    }
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
    guardian_beat(&port->guard, now);
    if (guardian_is_halted(&port->guard, now))
        guard_died(port);
    while (!is_pending(port) && now >= script_due_us(&port->script, now))
        port_step(port);
    port_pulse(port, now);
    look_again(port, now);
}

/* Reads, and handles nothing yet. False: Erlang has closed. */
static bool erlang_ready(struct port *port, short events)
{
    if (events & POLLIN && !frames_read(&port->in))
        return false;
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
    port->device.fd = port->guard.socket = port->reader.in.fd = -1;
    port->toggle_us = port->break_us = NEVER;
}

/* Erlang has ended while the cable is out, and the robot may drive: its wheels are stopped when it is
 * back, unless another program has its line by then. One that is asked to end, ends. */
static void stop_when_back(struct port *port)
{
    struct failure why = {.word = ""};
    uint64_t until = clock_us() + STAYS_US;
    /* whoever reads what a command of Erlang's prints waits for no robot */
    let_go_of_streams();
    while (!is_ended && clock_us() < until && strcmp(why.word, "busy") != 0) {
        if (device_open(&port->device, port->device.path, port->device.baud, &why)) {
            device_stop(&port->device, port->stop, port->stop_length, STOP_LIMIT_US);
            device_close(&port->device);
            return;
        }
        clock_sleep_us(LOOK_LATER_US);
    }
}

int port_run(const char *priority)
{
    static struct port port;
    struct pollfd fds[POLLED];
    prepare(&port);
    port_say(&port, 'p', priority);
    while (!is_ended) {
        wait_for(&port, fds);
        bool is_open = erlang_ready(&port, fds[IN].revents) && !(fds[OUT].revents & POLLERR);
        if (port.guard.socket >= 0 && fds[GUARD].fd == port.guard.socket)
            ask_guard(&port, fds[GUARD].revents);
        messages(&port);
        if (!is_open)
            break;
        if (fds[OUT].revents & POLLOUT)
            frames_flush(&port.out);
        if (port.device.fd >= 0 && fds[LINE].fd == port.reader.in.fd && fds[LINE].revents)
            line_ready(&port);
        if (is_pending(&port))
            port_flush(&port);
        messages(&port);
        time_passed(&port);
    }
    bool is_out = port.is_lost && port.may_move;
    port_close(&port);
    if (is_out)
        stop_when_back(&port);
    return 0;
}
