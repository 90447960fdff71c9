"""A client under test: climbs to 3 m, looks round, lands. python look_round.py ADDRESS"""

import sys

from hil_companion import Desired, Frame, run


def look_round(frame: Frame) -> Desired:
    t_s = frame.t_ns * 1e-9
    if t_s > 25.0:
        return Desired(land=True)
    return Desired(p_W=(0.0, 0.0, 3.0), yaw_rad=0.4 * t_s)


if __name__ == "__main__":
    sys.exit(run(look_round, sys.argv[1], name="look_round", topics=["truth"], control=True))
