// Copyright 2026 The smart_tire developers
//
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
// in compliance with the License. You may obtain a copy of the License at
// http://www.apache.org/licenses/LICENSE-2.0
// Unless required by applicable law or agreed to in writing, software distributed under the License
// is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
// or implied. See the License for the specific language governing permissions and limitations under
// the License.

// Shifts CLOCK_REALTIME by CLOCK_SKEW_NS, loaded by LD_PRELOAD.

#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <time.h>

int clock_gettime(clockid_t clock, struct timespec *now)
{
  static int (*real)(clockid_t, struct timespec *);
  if (!real) {
    real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
  }
  int status = real(clock, now);
  const char *skew = getenv("CLOCK_SKEW_NS");
  if (!status && clock == CLOCK_REALTIME && skew) {
    long long ns = now->tv_nsec + atoll(skew);
    long long whole = ns / 1000000000 - (ns % 1000000000 < 0);
    now->tv_sec += whole;
    now->tv_nsec = ns - whole * 1000000000;
  }
  return status;
}
