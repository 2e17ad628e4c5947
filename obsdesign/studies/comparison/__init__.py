"""All kinds on one record, and a Kalman filter with them."""
