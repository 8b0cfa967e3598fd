/* Faults of the disk, for tests: preloaded (LD_PRELOAD), it counts every call that changes something under the folder
 * FAULTS_UNDER, and fails number FAULTS_AT of them (with FAULTS_STAY set all later ones too) with the error FAULTS_ERROR.
 * What it failed is appended to the file FAULTS_LOG, which lies elsewhere. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

static atomic_long count;

static int under(const char* path) {
    const char* folder = getenv("FAULTS_UNDER");
    return folder && strncmp(path, folder, strlen(folder)) == 0;
}

static int path_counts(const char* path) {
    char full[2 * PATH_MAX];
    if (path[0] == '/') return under(path);
    if (!getcwd(full, PATH_MAX)) return 0;
    strcat(full, "/");
    strncat(full, path, PATH_MAX - 1);
    return under(full);
}

static int descriptor_counts(int fd) {
    char link[64], path[PATH_MAX];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    const ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0) return 0;
    path[length] = 0;
    return under(path);
}

/* True if this call is to fail; errno says why. */
static int fails(const char* what) {
    const char* at = getenv("FAULTS_AT");
    if (!at) return 0;
    const long number = atomic_fetch_add(&count, 1) + 1, wanted = atol(at);
    if (number != wanted && !(number > wanted && getenv("FAULTS_STAY"))) return 0;
    const char* log = getenv("FAULTS_LOG");
    const int fd = log ? (int)syscall(SYS_openat, AT_FDCWD, log, O_WRONLY | O_CREAT | O_APPEND, 0600) : -1;
    if (fd >= 0) {
        char line[64];
        const int length = snprintf(line, sizeof line, "%ld %s\n", number, what);
        syscall(SYS_write, fd, line, (size_t)length);
        syscall(SYS_close, fd);
    }
    errno = atoi(getenv("FAULTS_ERROR"));
    return 1;
}

#define NEXT(type, name, ...) ((type(*)(__VA_ARGS__))dlsym(RTLD_NEXT, #name))

ssize_t write(int fd, const void* bytes, size_t n) {
    if (descriptor_counts(fd) && fails("write")) return -1;
    return NEXT(ssize_t, write, int, const void*, size_t)(fd, bytes, n);
}
ssize_t writev(int fd, const struct iovec* parts, int n) {
    if (descriptor_counts(fd) && fails("writev")) return -1;
    return NEXT(ssize_t, writev, int, const struct iovec*, int)(fd, parts, n);
}
ssize_t pwrite(int fd, const void* bytes, size_t n, off_t at) {
    if (descriptor_counts(fd) && fails("pwrite")) return -1;
    return NEXT(ssize_t, pwrite, int, const void*, size_t, off_t)(fd, bytes, n, at);
}
ssize_t pwrite64(int fd, const void* bytes, size_t n, off64_t at) {
    if (descriptor_counts(fd) && fails("pwrite64")) return -1;
    return NEXT(ssize_t, pwrite64, int, const void*, size_t, off64_t)(fd, bytes, n, at);
}
int fsync(int fd) {
    if (descriptor_counts(fd) && fails("fsync")) return -1;
    return NEXT(int, fsync, int)(fd);
}
int fdatasync(int fd) {
    if (descriptor_counts(fd) && fails("fdatasync")) return -1;
    return NEXT(int, fdatasync, int)(fd);
}
int fchmod(int fd, mode_t mode) {
    if (descriptor_counts(fd) && fails("fchmod")) return -1;
    return NEXT(int, fchmod, int, mode_t)(fd, mode);
}
int chmod(const char* path, mode_t mode) {
    if (path_counts(path) && fails("chmod")) return -1;
    return NEXT(int, chmod, const char*, mode_t)(path, mode);
}
int rename(const char* from, const char* to) {
    if (path_counts(to) && fails("rename")) return -1;
    return NEXT(int, rename, const char*, const char*)(from, to);
}
int link(const char* from, const char* to) {
    if (path_counts(to) && fails("link")) return -1;
    return NEXT(int, link, const char*, const char*)(from, to);
}
int linkat(int a, const char* from, int b, const char* to, int flags) {
    if (path_counts(to) && fails("linkat")) return -1;
    return NEXT(int, linkat, int, const char*, int, const char*, int)(a, from, b, to, flags);
}
int mkdir(const char* path, mode_t mode) {
    if (path_counts(path) && fails("mkdir")) return -1;
    return NEXT(int, mkdir, const char*, mode_t)(path, mode);
}
ssize_t copy_file_range(int in, off64_t* from, int out, off64_t* to, size_t n, unsigned flags) {
    if (descriptor_counts(out) && fails("copy_file_range")) return -1;
    return NEXT(ssize_t, copy_file_range, int, off64_t*, int, off64_t*, size_t, unsigned)(in, from, out, to, n, flags);
}

#define OPENS(name)                                                           \
    int name(const char* path, int flags, ...) {                              \
        va_list rest;                                                         \
        va_start(rest, flags);                                                \
        const mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0; \
        va_end(rest);                                                         \
        if (flags & (O_WRONLY | O_RDWR | O_CREAT) && path_counts(path) && fails(#name)) return -1; \
        return NEXT(int, name, const char*, int, ...)(path, flags, mode);     \
    }
OPENS(open)
OPENS(open64)
