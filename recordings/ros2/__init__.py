"""Recordings for the tools of ROS 2: messages in CDR, with their definitions, in an MCAP file."""
