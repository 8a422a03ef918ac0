//! What the demo and the tests need of the system, what of it is missing, and getting it.
//!
//! Linux only: Windows and macOS bring their graphics drivers and windows along.

mod machine;
mod packages;
mod vulkan;

use std::process::Command;

use crate::{Failure, run};
pub use machine::Machine;
use packages::Manager;

/// Something of the system without which a part of the work cannot be done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    VulkanLoader,
    VulkanDriver,
    WindowLibraries,
    /// A display in memory, and what types, clicks and takes pictures on it.
    VirtualDisplay,
}

impl Need {
    /// For the reader of the announcement.
    fn purpose(self) -> &'static str {
        match self {
            Need::VulkanLoader => "the Vulkan loader, through which every picture is drawn",
            Need::VulkanDriver => {
                "a software Vulkan driver, which draws on the processor: no GPU driver was found"
            }
            Need::WindowLibraries => "X libraries, with which the viewer opens its window",
            Need::VirtualDisplay => "a virtual display, on which the tests open the viewer",
        }
    }

    /// Without Vulkan next to nothing can be shown or tested. The window's tests alone can be
    /// skipped, and say so.
    fn is_essential(self) -> bool {
        matches!(self, Need::VulkanLoader | Need::VulkanDriver)
    }

    fn is_met(self, machine: &Machine) -> bool {
        let libraries = |names: &[&str]| names.iter().all(|name| machine.has_library(name));
        let programs = |names: &[&str]| names.iter().all(|name| machine.has_program(name));
        match self {
            Need::VulkanLoader => libraries(&["libvulkan.so.1"]),
            Need::VulkanDriver => vulkan::has_driver(machine),
            Need::WindowLibraries => libraries(&[
                "libX11.so.6",
                "libX11-xcb.so.1",
                "libXcursor.so.1",
                "libXi.so.6",
                "libXrandr.so.2",
                "libxkbcommon-x11.so.0",
            ]),
            Need::VirtualDisplay => programs(&["Xvfb", "xdotool", "import"]),
        }
    }
}

/// Installs what is missing of `needs`, saying so first; where it must not, refuses and says
/// what to run.
pub fn provide(needs: &[Need], may_install: bool) -> Result<(), Failure> {
    if !cfg!(target_os = "linux") {
        return Ok(());
    }

    // Say what is missing, and what for.
    let machine = Machine::this();
    let missing = |needs: &[Need]| -> Vec<Need> {
        needs.iter().copied().filter(|need| !need.is_met(&machine)).collect()
    };
    let needs = missing(needs);
    if needs.is_empty() {
        return Ok(());
    }
    println!("Missing here:");
    for need in &needs {
        println!("  {}", need.purpose());
    }

    // Find out with what to install it, and whether we may.
    let Some(manager) = Manager::of(&machine) else {
        return judge(&needs, "This system's package manager is not known to us: see yourself to");
    };
    let is_root = user_is_root();
    let has_sudo = machine.has_program("sudo");
    let commands = manager.commands(&needs, if has_sudo && !is_root { &["sudo"] } else { &[] });
    if !may_install || !(is_root || has_sudo) {
        let line = commands.iter().map(run::shown).collect::<Vec<_>>().join("; ");
        return Err(Failure::Missing(format!("Install it as root and run this again:\n  {line}")));
    }

    // Install it. What counts is not how that ends, but what is there afterwards.
    println!("Installing it, which takes a minute or two:");
    for mut command in commands {
        if let Err(Failure::Work(message)) = run::run(&mut command) {
            println!("{message}");
        }
    }
    judge(&missing(&needs), "Still missing:")
}

/// Stops where something essential is missing, goes on with a warning where not.
fn judge(missing: &[Need], complaint: &str) -> Result<(), Failure> {
    let purposes: Vec<&str> = missing.iter().map(|need| need.purpose()).collect();
    let message = format!("{complaint}\n  {}", purposes.join("\n  "));
    if missing.iter().any(|need| need.is_essential()) {
        return Err(Failure::Missing(message));
    }
    if !missing.is_empty() {
        println!("{message}\nGoing on without.");
    }
    Ok(())
}

fn user_is_root() -> bool {
    Command::new("id").arg("-u").output().is_ok_and(|output| output.stdout.trim_ascii() == b"0")
}
