"""Where agents believe they are: noise of global poses, odometry, and what agents state of both."""
