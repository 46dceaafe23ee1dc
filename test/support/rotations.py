"""Rotation of vectors, independent of smart_tire."""


def rotate(quaternion, vector):
    """Return ``vector`` rotated by ``quaternion`` (x, y, z, w), from body to world axes."""
    x, y, z, w = quaternion
    a, b, c = vector
    t = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return (a + w * t[0] + y * t[2] - z * t[1], b + w * t[1] + z * t[0] - x * t[2],
            c + w * t[2] + x * t[1] - y * t[0])
