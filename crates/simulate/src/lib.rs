//! Scenes, runs and run folders.
