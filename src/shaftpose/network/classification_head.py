"""SSD-6D's head (Kehl et al., 2017): the pose as classes."""

from shaftpose.network.heads import ArchitectureC


class ArchitectureB(ArchitectureC):
    """SSD-6D's head (paper, Fig. (b)): class, box and one-hot pose side by side from each map.

    The paper made Architecture C from it by putting numbers in the place of classes. Their
    convolutions are the same but for the `pose_values`: five for C, for B one for each bin of its
    variant's `BinCoder`.
    """
