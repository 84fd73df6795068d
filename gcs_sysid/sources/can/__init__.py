"""Sensors and actuators on CAN: DroneCAN frames in log files, or tunnelled through MAVLink."""
