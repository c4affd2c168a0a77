"""Take the columns of the comma2k19 example segment that a lateral model needs.

Run once, with numpy: ``python make_rav4.py SRC_DIR``. SRC_DIR holds ``segment40_50Hz.csv`` (see README.md). Writes
``rav4.csv`` beside this file; the same bytes every time. Row k is sample k at 50 Hz:

=========  ====================================================================================
speed      m/s
steering   rad at the road wheel, left positive: steering wheel over the ratio 16.88
yaw_rate   rad/s, left positive, with the sensor's own offset of about -0.0077
a_y        m/s2, left positive (the sensor counts right)
=========  ====================================================================================
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

RATIO = 16.88


def main() -> int:
    """Convert the segment.

    Returns
    -------
    int
        Exit status: 0 done, 2 usage.

    """
    if len(sys.argv) != 2:
        print("usage: make_rav4.py SRC_DIR", file=sys.stderr)
        return 2
    record = np.genfromtxt(Path(sys.argv[1]) / "segment40_50Hz.csv", delimiter=",", names=True)
    columns = (record["v_mps"], np.deg2rad(record["steer_wheel_deg"]) / RATIO, np.deg2rad(record["yaw_rate_can_dps"]),
               -record["ay_can_mps2"])
    lines = ["speed,steering,yaw_rate,a_y"]
    lines += [f"{v:.4f},{s:.7f},{r:.6f},{a:.5f}" for v, s, r, a in zip(*columns)]
    (Path(__file__).parent / "rav4.csv").write_bytes(("\n".join(lines) + "\n").encode())
    return 0


if __name__ == "__main__":
    sys.exit(main())
