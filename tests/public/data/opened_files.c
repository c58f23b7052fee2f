/* Preloaded into a program and its children: a line in the file $OPENED_FILES for each file that is opened by name, with the
 * folder that its thread stands in. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static int log_file = -1;

__attribute__((constructor)) static void start(void) {
    int (*plain)(const char *, int, ...) = dlsym(RTLD_NEXT, "open");
    const char *name = getenv("OPENED_FILES");
    if (name) log_file = plain(name, O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0644);
}

static void note(const char *name) {
    char folder[4096] = "", line[9000];
    if (log_file < 0 || !name) return;
    if (name[0] != '/' && !getcwd(folder, sizeof folder)) return;
    int length = snprintf(line, sizeof line, "%s%s%s\n", folder, folder[0] ? "/" : "", name);
    if (length > 0 && length < (int)sizeof line && write(log_file, line, length) < 0) return;
}

#define OPEN(symbol)                                                                  \
    int symbol(const char *name, int flags, ...) {                                    \
        va_list more;                                                                 \
        va_start(more, flags);                                                        \
        int mode = va_arg(more, int);                                                 \
        va_end(more);                                                                 \
        note(name);                                                                   \
        int (*next)(const char *, int, ...) = dlsym(RTLD_NEXT, #symbol);              \
        return next(name, flags, mode);                                               \
    }
OPEN(open)
OPEN(open64)

#define OPEN_AT(symbol)                                                               \
    int symbol(int folder, const char *name, int flags, ...) {                        \
        va_list more;                                                                 \
        va_start(more, flags);                                                        \
        int mode = va_arg(more, int);                                                 \
        va_end(more);                                                                 \
        if (folder == AT_FDCWD || (name && name[0] == '/')) note(name);               \
        int (*next)(int, const char *, int, ...) = dlsym(RTLD_NEXT, #symbol);         \
        return next(folder, name, flags, mode);                                       \
    }
OPEN_AT(openat)
OPEN_AT(openat64)

#define FOPEN(symbol)                                                                 \
    FILE *symbol(const char *name, const char *mode) {                                \
        note(name);                                                                   \
        FILE *(*next)(const char *, const char *) = dlsym(RTLD_NEXT, #symbol);        \
        return next(name, mode);                                                      \
    }
FOPEN(fopen)
FOPEN(fopen64)

void *dlopen(const char *name, int flags) {
    if (name && strchr(name, '/')) note(name);
    void *(*next)(const char *, int) = dlsym(RTLD_NEXT, "dlopen");
    return next(name, flags);
}
