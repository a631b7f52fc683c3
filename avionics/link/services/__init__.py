"""MAVLink's services, one file each: messages and a wall-clock time in, replies and commands out."""
