/* Which process holds a device: what /proc tells. */
#include "device.h"

#include <ctype.h>
#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static bool has_open(const char *pid, const char *real)
{
    char name[300], target[PATH_LENGTH];
    bool found = false;
    snprintf(name, sizeof name, "/proc/%.20s/fd", pid);
    DIR *dir = opendir(name);
    for (struct dirent *at; dir && !found && (at = readdir(dir));) {
        snprintf(name, sizeof name, "/proc/%.20s/fd/%.200s", pid, at->d_name);
        ssize_t length = readlink(name, target, sizeof target - 1);
        target[length > 0 ? length : 0] = 0;
        found = length > 0 && strcmp(target, real) == 0;
    }
    if (dir)
        closedir(dir);
    return found;
}

static void describe(const char *pid, char *text, size_t size)
{
    char name[64], command[64] = "";
    snprintf(name, sizeof name, "/proc/%.20s/comm", pid);
    FILE *file = fopen(name, "r");
    if (file) {
        if (!fgets(command, sizeof command, file))
            command[0] = 0;
        fclose(file);
    }
    command[strcspn(command, "\n")] = 0;
    snprintf(text, size, "process %.20s (%s)", pid, command);
}

void device_holder(const char *path, char *text, size_t size)
{
    char real[PATH_LENGTH], own[24];
    char *resolved = realpath(path, NULL);
    snprintf(real, sizeof real, "%s", resolved ? resolved : path);
    free(resolved);
    snprintf(own, sizeof own, "%ld", (long)getpid());
    snprintf(text, size, "another process");
    DIR *dir = opendir("/proc");
    for (struct dirent *at; dir && (at = readdir(dir));) {
        if (!isdigit((unsigned char)at->d_name[0]) || strcmp(at->d_name, own) == 0)
            continue;
        if (has_open(at->d_name, real)) {
            describe(at->d_name, text, size);
            break;
        }
    }
    if (dir)
        closedir(dir);
}
