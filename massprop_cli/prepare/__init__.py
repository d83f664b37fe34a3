"""Log → Samples: commands aligned with what executed, IMU data in body axes at O."""
