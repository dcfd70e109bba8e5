"""Sheets and pages that show what was calibrated or learned."""
