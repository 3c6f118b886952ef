"""Estimation of a muscle that changes: slow change, sudden change, disturbance, dynamics."""
