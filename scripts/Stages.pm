# Stages.pm: running the programs: a command and its --stats, and the six stages one after another
# over one scene, each with the files that it needs. For scripts/report and scripts/scaling.
package Stages;
use strict;
use warnings;
use Cwd qw(abs_path);
use File::Basename qw(dirname);
use File::Temp qw(tempdir);
use JSON::PP ();

my $top = abs_path(dirname(__FILE__) . '/..');

# In a folder of its own, which goes away at the end.
sub new {
    my ($class, $build) = @_;
    $ENV{PATH} = abs_path($build) . "/bin:$ENV{PATH}";
    $ENV{LC_ALL} = 'C';
    $SIG{$_} = sub { print STDERR "\nstopped; the same command goes on from here\n"; exit 130 } for qw(INT TERM);
    return bless { work => tempdir(CLEANUP => 1), made => {} }, $class;
}

# Output that would be an error's goes into the message; the first line of it.
sub run {
    my ($self, $command) = @_;
    my $said = `cd '$self->{work}' && { $command; } 2>&1`;
    return $said unless $?;
    my ($first) = split /\n/, $said;
    die(($first // "$command: status " . ($? >> 8)) . "\n");
}

# One program: its --stats.
sub tool {
    my ($self, $command) = @_;
    $self->run("$command -q --stats stats.json");
    open my $f, '<', "$self->{work}/stats.json" or die "stats.json: $!\n";
    return JSON::PP::decode_json(join '', <$f>);
}

# A file that is made when it is wanted for the first time: an earlier run may have had it.
sub need { my ($self, $file, $command) = @_; $self->run("$command -o $file") unless $self->{made}{$file}++; return $file }

# ---- the stages ----

our @names = qw(import gbuffer sample voxelize simplify flatten);
my %command = (
    import   => 'pbs-import mesh',
    gbuffer  => 'pbs-gbuffer import',
    sample   => 'pbs-sample gbuffer',
    voxelize => 'pbs-voxelize -r 1024 import',
    simplify => 'pbs-simplify voxelize',
    flatten  => 'pbs-flatten sample simplify',
);

# Options of the stages, instead of the defaults: NAME => OPTIONS...
sub settings {
    my ($self, %options) = @_;
    $command{$_} =~ s/^(\S+)( -r 1024)?/$1 $options{$_}/ for keys %options;
}

# The scene that the stages are for: path => of a file, or command => that writes it.
sub scene {
    my ($self, %which) = @_;
    $self->forget('mesh', @names);
    $self->{scene} = \%which;
}
sub forget {
    my ($self, @files) = @_;
    unlink map { "$self->{work}/$_" } @files;
    delete @{ $self->{made} }{@files};
}

# The command of a stage, whose input is made first if it is not there.
sub command {
    my ($self, $name) = @_;
    for my $file ($command{$name} =~ / ([a-z]{2,})\b/g) {
        next if $self->{made}{$file}++;
        if ($file ne 'mesh') { $self->run($self->command($file) . " -q -o $file") }
        elsif ($self->{scene}{command}) { $self->run("$self->{scene}{command} >mesh") }
    }
    my $path = $self->{scene}{path};
    return defined $path ? $command{$name} =~ s/mesh/'--ignore-missing ' . quoted($path)/er : $command{$name};
}

# For the shell.
sub quoted { my $text = shift; return "'" . ($text =~ s/'/'\\''/gr) . "'" }

# The figures of a stage; its result stays, for the stages after it. to: a file instead, and with it
# the figures have the member "sum", of its bytes.
sub stage {
    my ($self, $name, $options, $to) = @_;
    my $figures = $self->tool($self->command($name) . " $options -o " . ($to // $name));
    if ($to) { $figures->{sum} = $self->run("cksum $to") =~ s/\s*\Q$to\E\s*//r }
    else { $self->{made}{$name} = 1 }
    return $figures;
}

# ---- generated scenes ----

# Writes a bumpy torus of N triangles, as PLY.
sub torus {
    my ($self, $n) = @_;
    my $cc = $ENV{CC} // 'cc';
    $self->run("$cc -O2 -o mkmesh '$top/tests/bench/mkmesh.c' -lm") unless $self->{made}{mkmesh}++;
    return "./mkmesh ply $n";
}
# The engine of make demo, N times; undef without it.
my $engine = '/usr/share/assimp/models/glTF2/2CylinderEngine-glTF-Binary/2CylinderEngine.glb';
sub plant { my ($self, $n) = @_; return -e $engine ? "'$top/scripts/mkplant' --bin plant.bin $engine $n" : undef }

1;
