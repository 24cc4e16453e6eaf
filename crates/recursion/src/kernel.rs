//! The one way into a kernel.

/// A type that holds the arguments of a kernel, and the kernel itself, always inlined: see [`phipsi_spatial::Kernel`].
macro_rules! kernel {
    ($name:ident<$life:lifetime, $t:ident> { $($field:ident: $type:ty),* $(,)? } -> $output:ty $body:block) => {
        struct $name<$life, $t: phipsi_spatial::Scalar> {
            $($field: $type),*
        }
        impl<$life, $t: phipsi_spatial::Scalar> phipsi_spatial::Kernel for $name<$life, $t> {
            type Output = $output;
            #[inline(always)]
            fn run(self) -> $output {
                let $name { $($field),* } = self;
                $body
            }
        }
    };
}
pub(crate) use kernel;
