"""Logs of other programs as logs of this one."""
