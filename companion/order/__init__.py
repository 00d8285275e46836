"""The operator's end: orders made and sent (`station`), counted (`order_file`), also for a ground station."""
