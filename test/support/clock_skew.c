// Copyright 2026 The smart_tire developers
//
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
// in compliance with the License. You may obtain a copy of the License at
// http://www.apache.org/licenses/LICENSE-2.0
// Unless required by applicable law or agreed to in writing, software distributed under the License
// is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
// or implied. See the License for the specific language governing permissions and limitations under
// the License.

// Shifts CLOCK_REALTIME, loaded by LD_PRELOAD.
//
// The file CLOCK_SKEW_FILE has the shift [ns], a 64-bit integer, which may change at any time.
// The kernel waits by its own clock: instants until which a thread waits are shifted back.

#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>

static const volatile long long *skew;

__attribute__((constructor)) static void map_file(void)
{
  int file = open(getenv("CLOCK_SKEW_FILE"), O_RDONLY | O_CLOEXEC);
  void *memory = mmap(NULL, sizeof *skew, PROT_READ, MAP_SHARED, file, 0);
  if (memory != MAP_FAILED) {
    skew = memory;
  }
}

// Times since the boot of a machine, which are those of the other clocks, are below.
#define MIN_REALTIME 1000000000

static struct timespec shifted(const struct timespec *when, long long by)
{
  long long ns = when->tv_nsec + by;
  long long whole = ns / 1000000000 - (ns % 1000000000 < 0);
  return (struct timespec){when->tv_sec + whole, ns - whole * 1000000000};
}

#define KERNEL_TIME(when) \
  struct timespec kernel = skew && (when)->tv_sec > MIN_REALTIME ? shifted(when, -*skew) : *(when)

int clock_gettime(clockid_t clock, struct timespec *now)
{
  static int (*real)(clockid_t, struct timespec *);
  if (!real) {
    real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
  }
  int status = real(clock, now);
  if (!status && clock == CLOCK_REALTIME && skew) {
    *now = shifted(now, *skew);
  }
  return status;
}

int pthread_cond_timedwait(pthread_cond_t *condition, pthread_mutex_t *mutex,
                           const struct timespec *when)
{
  static int (*real)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);
  if (!real) {  // the unversioned name is that of LinuxThreads
    real = (int (*)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *))dlvsym(
      RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2");
  }
  KERNEL_TIME(when);
  return real(condition, mutex, &kernel);
}

int pthread_cond_clockwait(pthread_cond_t *condition, pthread_mutex_t *mutex, clockid_t clock,
                           const struct timespec *when)
{
  static int (*real)(pthread_cond_t *, pthread_mutex_t *, clockid_t, const struct timespec *);
  if (!real) {
    real = (int (*)(pthread_cond_t *, pthread_mutex_t *, clockid_t, const struct timespec *))dlsym(
      RTLD_NEXT, "pthread_cond_clockwait");
  }
  KERNEL_TIME(when);
  return real(condition, mutex, clock, &kernel);
}

int pthread_mutex_timedlock(pthread_mutex_t *mutex, const struct timespec *when)
{
  static int (*real)(pthread_mutex_t *, const struct timespec *);
  if (!real) {
    real = (int (*)(pthread_mutex_t *, const struct timespec *))dlsym(
      RTLD_NEXT, "pthread_mutex_timedlock");
  }
  KERNEL_TIME(when);
  return real(mutex, &kernel);
}

int pthread_mutex_clocklock(pthread_mutex_t *mutex, clockid_t clock, const struct timespec *when)
{
  static int (*real)(pthread_mutex_t *, clockid_t, const struct timespec *);
  if (!real) {
    real = (int (*)(pthread_mutex_t *, clockid_t, const struct timespec *))dlsym(
      RTLD_NEXT, "pthread_mutex_clocklock");
  }
  KERNEL_TIME(when);
  return real(mutex, clock, &kernel);
}

int sem_timedwait(sem_t *semaphore, const struct timespec *when)
{
  static int (*real)(sem_t *, const struct timespec *);
  if (!real) {
    real = (int (*)(sem_t *, const struct timespec *))dlsym(RTLD_NEXT, "sem_timedwait");
  }
  KERNEL_TIME(when);
  return real(semaphore, &kernel);
}
