//! Package managers, and what they call what we need.

use std::process::Command;

use super::{Machine, Need};

pub struct Manager {
    program: &'static str,
    /// Brings the list of packages up to date: an old one names versions that are gone.
    refresh: Option<&'static str>,
    install: &'static str,
    vulkan_loader: &'static str,
    vulkan_driver: &'static str,
    window_libraries: &'static str,
    virtual_display: &'static str,
}

/// Only Debian's line is tried regularly (Debian 12); the others follow these systems' lists.
const MANAGERS: [Manager; 4] = [
    Manager {
        program: "apt-get",
        refresh: Some("apt-get update"),
        install: "env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends",
        vulkan_loader: "libvulkan1",
        vulkan_driver: "mesa-vulkan-drivers",
        window_libraries: "libx11-6 libx11-xcb1 libxcursor1 libxi6 libxrandr2 libxkbcommon-x11-0",
        virtual_display: "xvfb xdotool imagemagick",
    },
    Manager {
        program: "dnf",
        refresh: None,
        install: "dnf install -y",
        vulkan_loader: "vulkan-loader",
        vulkan_driver: "mesa-vulkan-drivers",
        window_libraries: "libX11 libX11-xcb libXcursor libXi libXrandr libxkbcommon-x11",
        virtual_display: "xorg-x11-server-Xvfb xdotool ImageMagick",
    },
    Manager {
        program: "pacman",
        refresh: None,
        install: "pacman -S --needed --noconfirm",
        vulkan_loader: "vulkan-icd-loader",
        vulkan_driver: "vulkan-swrast",
        window_libraries: "libx11 libxcursor libxi libxrandr libxkbcommon-x11",
        virtual_display: "xorg-server-xvfb xdotool imagemagick",
    },
    Manager {
        program: "zypper",
        refresh: None,
        install: "zypper --non-interactive install",
        vulkan_loader: "libvulkan1",
        vulkan_driver: "libvulkan_lvp",
        window_libraries: "libX11-6 libX11-xcb1 libXcursor1 libXi6 libXrandr2 libxkbcommon-x11-0",
        virtual_display: "xorg-x11-server-Xvfb xdotool ImageMagick",
    },
];

impl Manager {
    /// This machine's package manager.
    pub fn of(machine: &Machine) -> Option<&'static Manager> {
        MANAGERS.iter().find(|manager| machine.has_program(manager.program))
    }

    /// What to run to install `needs`, each command after the words of `prefix`.
    pub fn commands(&self, needs: &[Need], prefix: &[&str]) -> Vec<Command> {
        let packages = needs.iter().flat_map(|need| self.packages(*need).split(' '));
        let install = self.install.split(' ').chain(packages).collect();
        let refresh = self.refresh.map(|line| line.split(' ').collect());
        let lines: Vec<Vec<&str>> = refresh.into_iter().chain([install]).collect();
        let command = |line: Vec<&str>| {
            let words = [prefix, &line].concat();
            let mut command = Command::new(words[0]);
            command.args(&words[1..]);
            command
        };
        lines.into_iter().map(command).collect()
    }

    fn packages(&self, need: Need) -> &'static str {
        match need {
            Need::VulkanLoader => self.vulkan_loader,
            Need::VulkanDriver => self.vulkan_driver,
            Need::WindowLibraries => self.window_libraries,
            Need::VirtualDisplay => self.virtual_display,
        }
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::super::machine::tests::Mock;
    use super::*;
    use crate::run::shown;

    fn lines(program: &str, needs: &[Need], prefix: &[&str]) -> Vec<String> {
        let mock = Mock::new(&[&format!("/usr/bin/{program}")], &[("PATH", "/usr/bin")]);
        let manager = Manager::of(&mock.0).expect("a known package manager");
        manager.commands(needs, prefix).iter().map(shown).collect()
    }

    #[test]
    fn debian_refreshes_first() {
        assert_eq!(
            lines("apt-get", &[Need::VulkanLoader, Need::VulkanDriver], &["sudo"]),
            [
                "sudo apt-get update",
                "sudo env DEBIAN_FRONTEND=noninteractive apt-get install -y \
                 --no-install-recommends libvulkan1 mesa-vulkan-drivers"
            ]
        );
    }

    #[test]
    fn others_do_it_themselves() {
        assert_eq!(lines("dnf", &[Need::VulkanLoader], &[]), ["dnf install -y vulkan-loader"]);
        assert!(Manager::of(&Mock::new(&[], &[("PATH", "/usr/bin")]).0).is_none());
    }

    #[test]
    fn tables_hold_single_words() {
        for manager in &MANAGERS {
            for need in [
                Need::VulkanLoader,
                Need::VulkanDriver,
                Need::WindowLibraries,
                Need::VirtualDisplay,
            ] {
                let packages = manager.packages(need);
                assert!(packages.split(' ').all(|name| !name.is_empty()), "{packages:?}");
            }
        }
    }
}
