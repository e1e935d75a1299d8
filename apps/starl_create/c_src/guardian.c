#include "guardian.h"

#include "clock.h"
#include "frame.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <termios.h>
#include <unistd.h>

enum { LIMIT_US = 1000000, BURY_TRIES = 100, BURY_PAUSE_US = 1000 };

bool write_all(int fd, const uint8_t *bytes, size_t length, uint64_t limit_us)
{
    uint64_t until = clock_us() + limit_us;
    while (length > 0 && clock_us() < until) {
        ssize_t sent = write(fd, bytes, length);
        if (sent > 0) {
            bytes += sent;
            length -= (size_t)sent;
        } else if (errno == EAGAIN) {
            struct pollfd room = {fd, POLLOUT, 0};
            poll(&room, 1, 10);
        } else if (errno != EINTR) {
            return false;
        }
    }
    return length == 0;
}

void let_go_of_streams(void)
{
    int null = open("/dev/null", O_RDWR);
    for (int fd = 0; fd <= 2; fd++)
        if (null >= 0)
            dup2(null, fd);
        else
            close(fd);
    if (null > 2)
        close(null);
}

/* Signals to the port program's group or terminal are not for the guardian. */
static void be_apart(void)
{
    setsid();
    signal(SIGINT, SIG_IGN);
    signal(SIGTERM, SIG_IGN);
    signal(SIGHUP, SIG_IGN);
    signal(SIGPIPE, SIG_IGN);
    let_go_of_streams();
}

/* What it knows of the line. */
struct watch {
    struct device dev;
    uint8_t stop[STOP_MAX];
    size_t length;
};

static void learn(struct watch *watch, const uint8_t *bytes, size_t length)
{
    if (bytes[0] == 'Z') {
        watch->length = length - 1 < STOP_MAX ? length - 1 : STOP_MAX;
        memcpy(watch->stop, bytes + 1, watch->length);
    } else if (bytes[0] == 'S' && length == 5) {
        watch->dev.baud = (unsigned)get_uint(bytes + 1, 4);
    }
}

static void stop_wheels(struct watch *watch)
{
    device_release(&watch->dev);
    device_stop(&watch->dev, watch->stop, watch->length, LIMIT_US);
}

static void say(int socket, char word)
{
    ssize_t ignored = send(socket, &word, 1, MSG_DONTWAIT | MSG_NOSIGNAL);
    (void)ignored;
}

/* Is there something to read within the time? It stops the wheels if not, and then waits on. */
static void wait_for(int socket, struct watch *watch)
{
    struct pollfd at = {socket, POLLIN, 0};
    int ready;
    do
        ready = poll(&at, 1, HALTED_US / 1000);
    while (ready < 0 && errno == EINTR);
    if (ready != 0)
        return;
    say(socket, 'w');
    stop_wheels(watch);
    say(socket, 'x');
    poll(&at, 1, -1);
}

/* Until the port program has ended (true) or dismisses it. */
static bool watched(int socket, struct watch *watch)
{
    static struct frames_in in;
    const uint8_t *bytes;
    size_t length;
    in.fd = socket;
    for (;;) {
        wait_for(socket, watch);
        if (!frames_read(&in))
            return true;
        while ((bytes = frames_next(&in, &length))) {
            if (length == 0)
                return false;
            if (bytes[0] == 'H')
                say(socket, 'h');
            else
                learn(watch, bytes, length);
        }
    }
}

/* A line that stays open elsewhere, as an emulator's does, must not stay locked for others. */
static void guard_line(int socket, struct watch *watch)
{
    if (!watched(socket, watch))
        return;
    stop_wheels(watch);
    ioctl(watch->dev.fd, TIOCNXCL);
}

pid_t fork_named(const char *name)
{
    char own[16];
    prctl(PR_GET_NAME, own);
    prctl(PR_SET_NAME, name);
    pid_t pid = fork();
    if (pid != 0)
        prctl(PR_SET_NAME, own);
    return pid;
}

bool guardian_start(struct guardian *guard, const struct device *dev, const uint8_t *stop,
                    size_t length)
{
    static struct watch watch;
    int ends[2];
    guard->socket = -1;
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0)
        return false;
    guard->pid = fork_named("starl_guardian");
    if (guard->pid == 0) {
        close(ends[1]);
        be_apart();
        watch.dev = *dev;
        watch.dev.notes = NULL; /* the port program's */
        watch.length = length;
        memcpy(watch.stop, stop, length);
        guard_line(ends[0], &watch);
        _exit(0);
    }
    close(ends[0]);
    if (guard->pid < 0) {
        close(ends[1]);
        return false;
    }
    set_nonblocking(ends[1]);
    guard->socket = ends[1];
    guard->beat_us = guard->heard_us = clock_us();
    return true;
}

/* One that is halted reads nothing; that is seen by its silence. */
static void tell(struct guardian *guard, char tag, const uint8_t *bytes, size_t length)
{
    uint8_t message[FRAME_HEAD + 1 + STOP_MAX];
    if (guard->socket < 0)
        return;
    message[0] = (uint8_t)((length + 1) >> 8);
    message[1] = (uint8_t)(length + 1);
    message[FRAME_HEAD] = (uint8_t)tag;
    if (length > 0)
        memcpy(message + FRAME_HEAD + 1, bytes, length);
    ssize_t ignored = send(guard->socket, message, FRAME_HEAD + 1 + length, MSG_NOSIGNAL);
    (void)ignored;
}

void guardian_teach(struct guardian *guard, const uint8_t *stop, size_t length)
{
    tell(guard, 'Z', stop, length);
}

void guardian_speed(struct guardian *guard, unsigned baud)
{
    uint8_t number[4];
    put_u32(number, baud);
    tell(guard, 'S', number, sizeof number);
}

/* The time in which no sign of life was asked for is none that it owes. */
void guardian_beat(struct guardian *guard, uint64_t now_us)
{
    if (guard->socket < 0 || now_us < guard->beat_us)
        return;
    if (now_us > guard->beat_us + HALTED_US)
        guard->heard_us = now_us;
    tell(guard, 'H', NULL, 0);
    guard->beat_us = now_us + BEAT_US;
}

enum guardian_word guardian_heard(struct guardian *guard, uint64_t now_us)
{
    char words[64];
    ssize_t got = recv(guard->socket, words, sizeof words, MSG_DONTWAIT);
    if (got <= 0)
        return GUARDIAN_WELL;
    guard->heard_us = now_us;
    if (memchr(words, 'x', (size_t)got) != NULL)
        return GUARDIAN_HAS_STOPPED;
    return memchr(words, 'w', (size_t)got) != NULL ? GUARDIAN_STOPS : GUARDIAN_WELL;
}

bool guardian_is_halted(const struct guardian *guard, uint64_t now_us)
{
    return guard->socket >= 0 && now_us > guard->heard_us + GUARD_HALTED_US;
}

void guardian_dismiss(struct guardian *guard)
{
    static const uint8_t empty[FRAME_HEAD];
    if (guard->socket >= 0) {
        ssize_t ignored = send(guard->socket, empty, sizeof empty, MSG_NOSIGNAL);
        (void)ignored;
    }
    guardian_bury(guard);
}

/* A dismissed guardian ends at once, and must be gone before the line is opened again; one that is
 * halted is not waited for. */
void guardian_bury(struct guardian *guard)
{
    if (guard->socket < 0)
        return;
    close(guard->socket);
    guard->socket = -1;
    for (int i = 0; i < BURY_TRIES; i++) {
        if (waitpid(guard->pid, NULL, WNOHANG) != 0)
            return;
        clock_sleep_us(BURY_PAUSE_US);
    }
    kill(guard->pid, SIGKILL);
    while (waitpid(guard->pid, NULL, 0) < 0 && errno == EINTR)
        ;
}
