"""Find surgical instrument shafts in one endoscope image and give each its 5-DoF pose."""
