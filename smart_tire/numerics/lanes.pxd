# Numbers side by side in C: arithmetic of Lanes is that of each number; in numpy, of arrays. Without
# the vectors of GCC and Clang it is one number. To Cython, Lanes is another type than double, which
# it must be for functions of both: what divides, or is assigned, must be Lanes, too.
cdef extern from *:
    """
    #ifndef SMART_TIRE_LANES
    #ifdef __GNUC__
    #define SMART_TIRE_LANES 2  /* doubles in a register of any processor with 64 bits */
    typedef double Lanes __attribute__((vector_size(8 * SMART_TIRE_LANES), aligned(8)));
    typedef long long LaneMask __attribute__((vector_size(8 * SMART_TIRE_LANES)));
    static inline Lanes lanes_select(Lanes a, Lanes b, Lanes x, Lanes y) {
        LaneMask larger = (LaneMask)(a > b);
        return (Lanes)(((LaneMask)x & larger) | ((LaneMask)y & ~larger));
    }
    static inline Lanes lanes_sqrt(Lanes x) {
        for (int i = 0; i < SMART_TIRE_LANES; i++) x[i] = __builtin_sqrt(x[i]);
        return x;
    }
    #else
    #include <math.h>
    #define SMART_TIRE_LANES 1
    typedef double Lanes;
    static inline Lanes lanes_select(Lanes a, Lanes b, Lanes x, Lanes y) { return a > b ? x : y; }
    static inline Lanes lanes_sqrt(Lanes x) { return sqrt(x); }
    #endif
    static inline Lanes lanes_of(double x) { Lanes zero = {0.0}; return zero + x; }
    #ifdef __SSE2__
    #include <emmintrin.h>
    static inline Lanes lanes_max(Lanes a, Lanes b) { return _mm_max_pd(a, b); }
    static inline Lanes lanes_min(Lanes a, Lanes b) { return _mm_min_pd(a, b); }
    #else
    static inline Lanes lanes_max(Lanes a, Lanes b) { return lanes_select(a, b, a, b); }
    static inline Lanes lanes_min(Lanes a, Lanes b) { return lanes_select(b, a, a, b); }
    #endif
    static inline Lanes lanes_abs(Lanes x) { return lanes_max(x, -x); }
    #endif
    """
    ctypedef float Lanes
    const int LANES "SMART_TIRE_LANES"
    Lanes lanes "lanes_of"(double x) noexcept
    Lanes where_larger "lanes_select"(Lanes a, Lanes b, Lanes x, Lanes y) noexcept  # a > b: x
    Lanes maximum "lanes_max"(Lanes a, Lanes b) noexcept
    Lanes minimum "lanes_min"(Lanes a, Lanes b) noexcept
    Lanes absolute "lanes_abs"(Lanes x) noexcept
    Lanes square_root "lanes_sqrt"(Lanes x) noexcept
