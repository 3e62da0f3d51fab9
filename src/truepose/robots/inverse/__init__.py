"""Inverse kinematics: all branches in closed form, Newton's method for calibrated and other arms."""
