"""SSD-6D's head (Kehl et al., 2017): the pose as classes."""

from shaftpose.network.ssd.heads import ArchitectureC


class ArchitectureB(ArchitectureC):
    """SSD-6D's head (paper, Fig. (b)): class, box and one-hot pose in parallel on each map.

    The paper derives Architecture C from it by replacing the pose classes with numbers. The
    convolutions differ only in `pose_values`: five for C, one per bin of the variant's `BinCoder`
    for B.
    """
