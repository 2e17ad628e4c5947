"""Every observer that a plant admits, on one record, side by side with a Kalman filter."""
