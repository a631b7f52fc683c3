"""Hardware interfaces of the flight code: sensor input and actuator output."""
