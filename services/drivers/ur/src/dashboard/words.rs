//! Words of the dashboard that are no modes of the robot.

use std::{fmt, str::FromStr};

macro_rules! words {
    ($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $word:literal,)+ }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum $name {
            $($(#[$variant_doc])* $variant,)+
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(match self { $(Self::$variant => $word,)+ })
            }
        }

        impl FromStr for $name {
            type Err = ();

            /// From the dashboard's word, in any case.
            fn from_str(word: &str) -> Result<Self, ()> {
                $(if word.eq_ignore_ascii_case($word) {
                    return Ok(Self::$variant);
                })+
                Err(())
            }
        }
    };
}

words! {
    /// What the program does that the pendant has loaded, or that was uploaded.
    Player {
        /// None runs.
        Stopped = "STOPPED",
        /// Runs.
        Playing = "PLAYING",
        /// Paused.
        Paused = "PAUSED",
    }
}

words! {
    /// Who operates a CB3's pendant.
    UserRole {
        /// May do everything.
        Programmer = "PROGRAMMER",
        /// May load and run programs.
        Operator = "OPERATOR",
        /// The pendant asks for no role.
        None = "NONE",
        /// May do nothing.
        Locked = "LOCKED",
        /// May run what is loaded.
        Restricted = "RESTRICTED",
    }
}

words! {
    /// Who may do what at an e-Series pendant.
    OperationalMode {
        /// Programs are made and changed.
        Manual = "MANUAL",
        /// Programs are run.
        Automatic = "AUTOMATIC",
    }
}
