#include "guardian.h"

#include "clock.h"
#include "frame.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
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

/* Signals to the port program's group or terminal are not for the guardian. */
static void be_apart(void)
{
    setsid();
    signal(SIGINT, SIG_IGN);
    signal(SIGTERM, SIG_IGN);
    signal(SIGHUP, SIG_IGN);
    signal(SIGPIPE, SIG_IGN);
    int null = open("/dev/null", O_RDWR);
    for (int fd = 0; fd <= 2; fd++)
        if (null >= 0)
            dup2(null, fd);
        else
            close(fd);
    if (null > 2)
        close(null);
}

/* What comes through the pipe are messages: the stop bytes; an empty one is the dismissal. */
static void watch(int pipe, int device, const uint8_t *stop, size_t length)
{
    static struct frames_in in;
    uint8_t known[STOP_MAX];
    const uint8_t *bytes;
    size_t got;
    memcpy(known, stop, length);
    in.fd = pipe;
    while (frames_read(&in))
        while ((bytes = frames_next(&in, &got))) {
            if (got == 0)
                return;
            length = got - 1 < STOP_MAX ? got - 1 : STOP_MAX;
            memcpy(known, bytes + 1, length);
        }
    write_all(device, known, length, LIMIT_US);
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

bool guardian_start(struct guardian *guard, int device, const uint8_t *stop, size_t length)
{
    int ends[2];
    guard->pipe = -1;
    if (pipe(ends) != 0)
        return false;
    guard->pid = fork_named("starl_guardian");
    if (guard->pid == 0) {
        close(ends[1]);
        be_apart();
        watch(ends[0], device, stop, length);
        _exit(0);
    }
    close(ends[0]);
    if (guard->pid < 0) {
        close(ends[1]);
        return false;
    }
    set_nonblocking(ends[1]);
    guard->pipe = ends[1];
    return true;
}

static void tell(struct guardian *guard, const uint8_t *bytes, size_t length)
{
    uint8_t message[FRAME_HEAD + 1 + STOP_MAX] = {(uint8_t)(length >> 8), (uint8_t)length};
    if (guard->pipe < 0)
        return;
    if (length > 0) {
        message[FRAME_HEAD] = 'Z';
        memcpy(message + FRAME_HEAD + 1, bytes, length - 1);
    }
    /* Shorter than PIPE_BUF: whole or not at all; one that has died is seen by the poll loop. */
    ssize_t ignored = write(guard->pipe, message, FRAME_HEAD + length);
    (void)ignored;
}

void guardian_teach(struct guardian *guard, const uint8_t *stop, size_t length)
{
    tell(guard, stop, length + 1);
}

void guardian_dismiss(struct guardian *guard)
{
    tell(guard, NULL, 0);
    guardian_bury(guard);
}

/* A dismissed guardian ends at once, and must be gone before the line is opened again; one that is
 * halted is not waited for. */
void guardian_bury(struct guardian *guard)
{
    if (guard->pipe < 0)
        return;
    close(guard->pipe);
    guard->pipe = -1;
    for (int i = 0; i < BURY_TRIES; i++) {
        if (waitpid(guard->pid, NULL, WNOHANG) != 0)
            return;
        clock_sleep_us(BURY_PAUSE_US);
    }
    kill(guard->pid, SIGKILL);
    while (waitpid(guard->pid, NULL, 0) < 0 && errno == EINTR)
        ;
}
