"""Makes the arrays beside this script: python3 tests/samples/numpy/make.py (NumPy 2.4.6).

  same.npz    the arrays of `arrays()` in tests/samples/mod.rs: what the library writes has the same bytes per array
  other.npz   byte orders, element types and orders of axes that the library reads and does not write
"""

from pathlib import Path

import numpy as np

HERE = Path(__file__).parent

single = np.array([1.5, -0.0, np.finfo(np.float32).tiny, 0, np.finfo(np.float32).max, -3.25], np.float32)
single.view(np.uint32)[3] = 1
np.savez(
    HERE / "same.npz",
    f32=single.reshape(2, 3),
    f64=np.array([1e-310, -0.0, np.pi]),
    u8=np.array([[0, 1], [128, 255]], np.uint8),
    i8=np.array([[-128, 0, 127]], np.int8),
    i32=np.array([-(2**31), 2**31 - 1], np.int32),
    i64=np.array([-(2**63), 2**63 - 1], np.int64),
    scalar=np.array(7, np.int64),
    empty=np.zeros((0, 3), np.float32),
)
np.savez_compressed(
    HERE / "other.npz",
    u16_big=np.array([[1, 2], [3, 65535]], ">u2"),
    i16=np.asfortranarray(np.array([[1, -2], [3, -32768]], "<i2")),
    u32=np.array([[0, 1], [2, 2**32 - 1]], "<u4"),
    u64=np.array([[0, 1], [2, 2**63 - 1]], ">u8"),
    f8=np.asfortranarray(np.array([[1, 2], [3, 4]], ">f8")),
    flag=np.array([[True, False], [False, True]]),
)
