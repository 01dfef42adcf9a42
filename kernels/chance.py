"""Numbers by which a path chooses: the same ones for a pixel and a sample, whatever the device, tiles or threads."""

import warp as wp

Primes = wp.types.vector(16, wp.int32)
PRIMES = wp.constant(Primes(2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53))


@wp.func
def chance(pixel: int, sample: int, dimension: int, stream: int) -> wp.float64:
    """A number in [0, 1) for each pixel, sample, dimension of the path and stream, which may stand for a light.

    Over the samples of a pixel, the first dimensions are additive recurrences by the roots of primes (Richtmyer 1951),
    more even than independent numbers; each pixel begins elsewhere (Cranley & Patterson 1976). Later ones are hashes.
    """
    start = wp.rand_init(pixel, dimension + 4096 * stream)
    if dimension < 16:
        x = wp.float64(wp.randf(start)) + wp.float64(sample) * wp.sqrt(wp.float64(PRIMES[dimension]))
        return x - wp.floor(x)
    return wp.float64(wp.randf(wp.rand_init(int(wp.randu(start)), sample)))
