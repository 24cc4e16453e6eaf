//! Closed chains against the dense twin, identities, mechanisms.

mod against_reference;
mod allocation;
mod closure_compliance;
mod flexible;
mod form_choice;
mod identities;
mod mechanisms;
mod plain_form;
mod square_root_form;
mod tree_choice;
