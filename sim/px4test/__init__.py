"""`make px4-test`: missions and failures flown live, on a real PX4 where there is one."""
