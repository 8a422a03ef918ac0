//! Waits for frames, so that the window does not.

use std::sync::{Arc, mpsc};
use std::time::Instant;

use winit::event_loop::EventLoopProxy;

use super::window::Wake;
use crate::gpu::Gpu;

/// A thread that waits.
pub struct Watcher {
    /// `None` only while ending.
    submissions: Option<mpsc::Sender<wgpu::SubmissionIndex>>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Watcher {
    /// For one device; wakes the window by `proxy`.
    pub fn start(gpu: Arc<Gpu>, proxy: EventLoopProxy<Wake>) -> Watcher {
        let (sender, submissions) = mpsc::channel();
        let thread = std::thread::spawn(move || {
            for submission in submissions {
                let wait =
                    wgpu::PollType::Wait { submission_index: Some(submission), timeout: None };
                let wake = match gpu.device.poll(wait) {
                    Ok(_) => Wake::FrameDone(Instant::now()),
                    Err(error) => Wake::Failed(error.to_string()),
                };
                // The window is gone: nobody needs to know.
                if proxy.send_event(wake).is_err() {
                    return;
                }
            }
        });
        Watcher { submissions: Some(sender), thread: Some(thread) }
    }

    /// Sends [`Wake::FrameDone`] when the submission is done.
    pub fn watch(&self, submission: wgpu::SubmissionIndex) {
        if let Some(submissions) = &self.submissions {
            // It has ended only where it has told that the GPU failed.
            let _ = submissions.send(submission);
        }
    }
}

impl Drop for Watcher {
    fn drop(&mut self) {
        self.submissions = None;
        if let Some(thread) = self.thread.take() {
            // Whether it panicked does not matter any more.
            let _ = thread.join();
        }
    }
}
