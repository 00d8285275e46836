"""The air of PX4's simulator SIH by its defaults, and a velocity control that is as slow in it as PX4's."""

from typing import Final

SIH_DRAG_PER_S: Final = 1.0  # SIH_KDV 1.0 N/(m/s) on SIH_MASS 1.0 kg
# Gains on the velocity error, 1/s and 1/s2; nothing is fed forward against drag. Level: fitted to what was seen of a
# step to 3 m/s, 2.16 m/s after 2.5 s and 2.9 after 15 s; PX4's own are 1.8 and 0.4. Vertical: PX4's own.
SIH_LEVEL_P: Final = 2.0  # MPC_XY_VEL_P_ACC
SIH_LEVEL_I: Final = 0.5  # MPC_XY_VEL_I_ACC
SIH_DOWN_P: Final = 4.0  # MPC_Z_VEL_P_ACC
SIH_DOWN_I: Final = 2.0  # MPC_Z_VEL_I_ACC
