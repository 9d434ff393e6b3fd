"""Bridge to a robot: packets, links, clocks, the side of the controller and the side of the robot."""
