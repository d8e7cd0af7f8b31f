"""Find surgical instrument shafts in one endoscope image and give each its 5-DoF pose."""

import os

# OpenCV refuses an image that states more pixels before it decodes it. It reads the limit when it
# is first imported.
MOST_PIXELS = "OPENCV_IO_MAX_IMAGE_PIXELS"
os.environ.setdefault(MOST_PIXELS, "100000000")
