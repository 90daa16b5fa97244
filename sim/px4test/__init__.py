"""Flight tests for `make px4-test`: missions and failures flown live, on a real PX4 if available."""
