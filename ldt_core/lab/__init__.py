"""What surrounds the product: study, challenge, tuning."""
