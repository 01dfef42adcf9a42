"""Device code: Warp functions, structs and kernel factories.

Leaves (transform, sphere, box, plane, triangle, grid, rounding) are flat functions, generic over float32 and
float64, that a test can launch alone. Factories put them together for one `Spec` and are memoised on it: what
a scene lacks is absent from the generated code. Nothing here knows of scene objects, files or pictures.
"""
