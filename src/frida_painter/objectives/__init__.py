"""What a painting is judged by while it is planned: functions of the rendered picture."""
