"""Recordings: rosbag2 folders with MCAP files, read and written without ROS.

`writer.BagWriter` writes one as it happens, `bag.read_bag` and `bag.experiments` read one,
`codec.encode` and `codec.decode` turn records into messages and back, `importers.import_file` makes
experiments of a CSV file or a foreign recording.
"""
